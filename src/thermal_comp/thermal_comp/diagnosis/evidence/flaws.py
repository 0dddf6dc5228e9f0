# SPDX-License-Identifier: Apache-2.0
"""What the equations of effects lack: how large it is, and which forms it may have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from scipy.interpolate import CubicSpline

from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.effect_sets import Component, EffectSet
from thermal_comp.diagnosis.evidence.generic_regressors import (
    RATE_PER_ORIENTATION,
    GenericRegressor,
)
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.linear.candidate_design import ColumnGroup
from thermal_comp.linear.gaussian_evidence import CoefficientPrior, ConditionedDesign, log_sum

THERMOMETER_SEEN_CHI2 = 20.0
"""Δχ² from which errors of the thermometer act, so that their equations may have a flaw."""
HISTORY_VARIABLES = frozenset({'rate', 'branch', 'phase'})
"""Variables that say how the temperature moved: what errors of a thermometer follow."""
STEPS_BETWEEN_AMPLITUDES = 2
"""Steps into which those of AMPLITUDES are parted, and each of them again by interpolation: the
evidence of a function of hundreds of coefficients has a peak narrower than a factor of two."""
_LOG_SIZES: FloatArray = np.log(priors.AMPLITUDES)
_FINE_LOG_SIZES: FloatArray = np.linspace(
    _LOG_SIZES[0], _LOG_SIZES[-1], STEPS_BETWEEN_AMPLITUDES * (len(_LOG_SIZES) - 1) + 1
)
_FINEST_LOG_SIZES: FloatArray = np.linspace(
    _LOG_SIZES[0], _LOG_SIZES[-1], STEPS_BETWEEN_AMPLITUDES**2 * (len(_LOG_SIZES) - 1) + 1
)
_INTERPOLATION: FloatArray = CubicSpline(_FINE_LOG_SIZES, np.eye(len(_FINE_LOG_SIZES)))(
    _FINEST_LOG_SIZES
)
"""What is smooth over ln of the amplitude, between."""
MOST_JOINT_FUNCTIONS = 3
"""Flexible functions that are weighed beside each other."""
LEAST_GAIN_FOR_ANOTHER = 2.0
"""Gain of ln evidence of the best of them from which another is looked for beside it."""


@dataclass(frozen=True, eq=False)
class FlexibleFunction:
    """A function that may act beside a set, of a size that is believed beforehand."""

    term: ColumnGroup
    log_prior: FloatArray
    """(s,) ln of the prior over AMPLITUDES."""
    largest: float = np.inf
    """√Δχ² beyond which it does not count."""
    beside: bool = True
    """Whether the prior is that of √Δχ² it adds beside all else; else of its coefficients, whose
    columns have unit length before anything else is taken out of them."""


@dataclass(frozen=True, eq=False)
class FittedSet:
    """A set with the equations beside its effects and what a free flaw adds."""

    set: EffectSet
    state: ConditionedDesign
    free_flaw: float
    course: float
    """ln of the evidence for a course that the runs share; −∞ where none was looked for."""
    variables_of_larger: frozenset[str]
    """Variables that a further effect in a larger set follows: any law of such a variable is that
    effect's law and its flaw, so it is weighed in the larger set."""

    @property
    def course_size(self) -> float:
        """√Δχ² of that course."""
        return size_of_gain(self.course)


def exact_weight(hypotheses: SensorHypotheses, some: EffectSet) -> float:
    """Return ln of the prior that the equations of a set lack nothing."""
    return (
        float(np.log(1.0 - priors.FORM_APPROXIMATE_PROBABILITY))
        if may_be_flawed(hypotheses, some)
        else 0.0
    )


def may_be_flawed(hypotheses: SensorHypotheses, some: EffectSet) -> bool:
    """Tell whether anything is explained by equations: effects' or the thermometer's."""
    return bool(some.beside(hypotheses.known).components) or thermometer_acts(hypotheses)


def thermometer_acts(hypotheses: SensorHypotheses) -> bool:
    """Tell whether errors of the thermometer are seen in the sensor's residual."""
    return hypotheses.explained_by_thermometer > THERMOMETER_SEEN_CHI2


def free_flaw(hypotheses: SensorHypotheses, some: EffectSet, state: ConditionedDesign) -> float:
    """Return ln of the evidence that a smooth function of all that was logged adds to a set.

    It is as large as a share of what the equations of effects and thermometer explain (Kennedy
    and O'Hagan, Bayesian Calibration of Computer Models, 2001).
    """
    explained = explained_by_equations(hypotheses, some)
    size, largest = priors.flaw_log_prior(explained), priors.LARGEST_FLAW_SHARE * explained
    function = FlexibleFunction(hypotheses.discrepancy, size, largest)
    return gain_of(state, function)[0]


def explained_by_equations(hypotheses: SensorHypotheses, some: EffectSet) -> float:
    """Return √Δχ² that the equations of effects and thermometer explain."""
    of_effects = some.beside(hypotheses.known).explained
    return float(np.sqrt(max(of_effects, hypotheses.explained_by_thermometer)))


def flaws(hypotheses: SensorHypotheses, fitted: Sequence[FittedSet]) -> list[float]:
    """Return ln of prior times evidence of a discrepancy of each set's equations.

    It has one of four forms, equally likely:

    - a smooth function of all that was logged;
    - a function of one variable: not of temperature, whose curves tell laws apart; of the phase of
      the cycle, which unlogged machines follow, only as a share of what effects of the
      temperature's history explain; one that errors of the thermometer may follow as a share of
      what these explain, any other as a share of what the effects explain;
    - the columns of a kindred effect, as a gradient's for a lag of two stages;
    - the columns of a step or a spectral line, each as one of all effects: what comes and goes
      looks like these by chance; no flaw of a law of temperature looks like one of time.

    What is proportional to a channel has no law that could look like another effect. The last two
    are weighed by the set that has that effect as well, with or without a flaw.
    """
    found: dict[int, float] = {}
    for place in sorted(range(len(fitted)), key=lambda k: -len(fitted[k].set.names)):
        some = fitted[place].set
        larger = []
        for other, flaw in found.items():
            further = Counter(fitted[other].set.names) - Counter(some.names)
            if further.total() == 1 and len(fitted[other].set.names) == len(some.names) + 1:
                whole = np.logaddexp(exact_weight(hypotheses, fitted[other].set), flaw)
                larger.append((next(iter(further)), fitted[other].set, float(whole)))
        found[place] = _flaw(hypotheses, fitted[place], larger)
    return [found[place] for place in range(len(fitted))]


def _flaw(
    hypotheses: SensorHypotheses, one: FittedSet, larger: Sequence[tuple[str, EffectSet, float]]
) -> float:
    """Return the flaw of one set; `larger`: effect more, set with it, its weight, flaw or not."""
    some = one.set
    whole = some.beside(hypotheses.known)
    log_prior = priors.flaw_log_prior(float(np.sqrt(whole.explained)))
    of_laws = _explained_by_laws(hypotheses, whole)
    likeness = priors.flaw_log_prior(of_laws, priors.LIKENESS_SHARE, priors.LIKENESS_SHARE_LN)
    functions = _functions(hypotheses, one)
    single = gains_together(hypotheses, some, one.state, functions)
    if whole.components:
        single.append(one.course + log_prior_at(one.course_size, log_prior))
    kin = _kin(hypotheses, whole)
    alike: list[float] = []
    others: list[float] = []
    for further, with_it, weight in larger:
        size = _more_explained(hypotheses, with_it, some)
        if size > priors.LARGEST_FLAW_SHARE * of_laws:
            continue
        gain = with_it.log_posterior - with_it.log_prior + some.log_prior - some.log_posterior
        if further in kin:
            alike.append(gain + weight + log_prior_at(size, likeness))
        elif _of_any_course(with_it, further):  # no flaw looks like slow noise
            size = _more_than_noise(hypotheses, with_it, some)
            others.append(gain + weight + log_prior_at(size, likeness))
    ways = [(one.free_flaw, 1)]
    ways += [(log_sum(single), len(single))] if single else []
    ways += [(log_sum(alike), len(kin))] if alike else []
    every = len(hypotheses.families) + len(hypotheses.guesses)
    ways += [(log_sum(others), every)] if others else []
    parts = [gain - float(np.log(count * len(ways))) for gain, count in ways]
    return log_sum(parts) + float(np.log(priors.FORM_APPROXIMATE_PROBABILITY))


def _of_any_course(some: EffectSet, name: str) -> bool:
    """Tell whether an effect of a set is a step or a spectral line: any course holds some."""
    effect = next(c.form.effect for c in some.components if c.name == name)
    return effect.repeatable or effect.line_frequency is not None


def _more_explained(hypotheses: SensorHypotheses, larger: EffectSet, some: EffectSet) -> float:
    """Return √Δχ² by which a larger set explains more, beside the same slow noise."""
    nuisances = hypotheses.likeliest_nuisances(larger.components)
    more = hypotheses.joint(larger.components, nuisances)[1]
    return float(np.sqrt(max(more - hypotheses.joint(some.components, nuisances)[1], 0.0)))


def _more_than_noise(hypotheses: SensorHypotheses, larger: EffectSet, some: EffectSet) -> float:
    """Return √Δχ² by which a larger set explains more than a set and its likeliest slow noise."""
    of_larger, of_some = (
        hypotheses.joint(one.components, hypotheses.likeliest_nuisances(one.components))[1]
        for one in (larger, some)
    )
    return float(np.sqrt(max(of_larger - of_some, 0.0)))


def _explained_by_laws(hypotheses: SensorHypotheses, some: EffectSet) -> float:
    """Return √Δχ² that laws of temperature, time or orientation explain, or the thermometer.

    What is proportional to a channel has no law that could look like another effect.
    """
    laws = [c for c in some.components if c.form.effect.kin]
    whole = len(laws) == len(some.components)
    of_effects = float(np.sqrt(some.explained)) if whole else _size_of(laws)
    return max(of_effects, float(np.sqrt(hypotheses.explained_by_thermometer)))


def _explained_by_history(some: EffectSet) -> float:
    """Return √Δχ² that effects of the temperature's history explain."""
    return _size_of([c for c in some.components if c.form.effect.kin == 'temperature'])


def _size_of(components: Sequence[Component]) -> float:
    """Return √Δχ² of a part of a set, by the amplitudes of its effects."""
    return float(np.linalg.norm([c.amplitude for c in components]))


def _kin(hypotheses: SensorHypotheses, some: EffectSet) -> set[str]:
    """Return the families kindred to an effect of the set, or to the temperature's errors."""
    families = [*hypotheses.families, *hypotheses.guesses]
    if not some.components:
        return {f.name for f in families if f.effect.kin == 'temperature'}
    effects = [c.form.effect for c in some.components]
    return {f.name for f in families if any(e.is_kin_of(f.effect()) for e in effects)}


def _functions(hypotheses: SensorHypotheses, one: FittedSet) -> list[FlexibleFunction]:
    """Return the functions of one variable that a flaw may be, as large as what they belong to.

    That of the frequency has no bound beside lines alone: one that comes and goes is mostly that.
    """
    some = one.set.beside(hypotheses.known)
    of_effects, of_history = float(np.sqrt(some.explained)), _explained_by_history(some)
    of_thermometer = float(np.sqrt(hypotheses.explained_by_thermometer))
    of_lines = all(c.form.effect.line_frequency is not None for c in some.components)
    left_out = {'temperature', *one.variables_of_larger}
    found = []
    for regressor in hypotheses.regressors:
        variable = regressor.depends_on
        sizes = []
        if variable not in left_out and some.components:
            sizes.append(of_history if variable == 'phase' else of_effects)
        if variable in HISTORY_VARIABLES - left_out or regressor.name == RATE_PER_ORIENTATION:
            sizes.append(of_thermometer)
        if (size := max(sizes, default=0.0)) > 0.0:
            log_prior = priors.flaw_log_prior(size) - log_places(regressor, some)
            comes_and_goes = of_lines and variable == 'frequency'
            largest = np.inf if comes_and_goes else priors.LARGEST_FLAW_SHARE * size
            # The lag beside it takes up most of a rate: the prior is that of the whole of it.
            beside = regressor.name != RATE_PER_ORIENTATION
            found.append(FlexibleFunction(regressor.term, log_prior, largest, beside))
    return found


def log_places(regressor: GenericRegressor, some: EffectSet) -> float:
    """Return ln of the number of bands from which that of a regressor was chosen.

    0 beside a set with a spectral line, whose frequency is known.
    """
    known = any(c.form.effect.line_frequency is not None for c in some.components)
    return 0.0 if known else float(np.log(regressor.places))


def gains_together(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    state: ConditionedDesign,
    functions: Sequence[FlexibleFunction],
    *,
    known: tuple[CoefficientPrior, ...] = (),
) -> list[float]:
    """Return ln of the evidence each flexible function adds; the best with others beside it.

    What acts rarely follows one variable alone: another may stand beside the best, and so on.
    """
    each = [gain_of(state, function) for function in functions]
    gains = [gain for gain, _ in each]
    place = int(np.argmax(gains)) if gains else 0
    if (
        len(gains) > 1
        and gains[place] > LEAST_GAIN_FOR_ANOTHER
        and len(known) + 1 < MOST_JOINT_FUNCTIONS
    ):
        columns, width = functions[place].term.columns, each[place][1]
        if functions[place].beside:
            width /= np.sqrt(state.power(columns))
        best = CoefficientPrior(columns, shared=False, deviation=np.full(len(columns), width))
        with_best = (*known, best)
        after = hypotheses.conditioned(some.components, with_best)
        others = [function for function in functions if function is not functions[place]]
        further = gains_together(hypotheses, some, after, others, known=with_best)
        more = log_sum(further) + float(np.log(priors.ANOTHER_EFFECT_PROBABILITY / len(others)))
        gains[place] = float(np.logaddexp(gains[place], gains[place] + more))
    return gains


def gain_of(state: ConditionedDesign, function: FlexibleFunction) -> tuple[float, float]:
    """Return ln of the evidence a flexible function adds and its best amplitude."""
    term = function.term
    evidence, explained = state.evidences(
        np.array([term.columns]),
        np.exp(_FINE_LOG_SIZES),
        shared=term.shared,
        beside=function.beside,
    )
    log_prior = np.interp(_FINEST_LOG_SIZES, _LOG_SIZES, function.log_prior) - 2.0 * np.log(
        STEPS_BETWEEN_AMPLITUDES
    )
    sizes = np.interp(_FINEST_LOG_SIZES, _FINE_LOG_SIZES, explained[0])
    log_prior[sizes > function.largest**2] = -1e300
    weighted = _INTERPOLATION @ (evidence[0] - state.log_evidence) + log_prior
    return log_sum(weighted), float(np.exp(_FINEST_LOG_SIZES[int(np.argmax(weighted))]))


def size_of_gain(gain: float) -> float:
    """Return √Δχ² of what adds so much ln evidence, about."""
    return float(np.sqrt(2.0 * max(gain, 0.0)))


def log_prior_at(size: float, log_prior: FloatArray) -> float:
    """Return ln of a prior over AMPLITUDES at an amplitude [√Δχ²]."""
    known = float(np.log(max(size, priors.AMPLITUDES[0])))
    return float(np.interp(known, np.log(priors.AMPLITUDES), log_prior))
