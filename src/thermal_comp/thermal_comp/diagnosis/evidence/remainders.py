# SPDX-License-Identifier: Apache-2.0
"""What may act beside the effects of a set: a flaw, a law without a name, a lost channel."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.acting_channels import channel_label
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.effect_sets import (
    NOT_IN_CATALOGUE,
    UNLOGGED,
    Component,
    EffectSet,
    Names,
)
from thermal_comp.diagnosis.evidence.flaws import (
    FittedSet,
    FlexibleFunction,
    exact_weight,
    gain_of,
    gains_together,
    log_places,
    log_prior_at,
    may_be_flawed,
    size_of_gain,
)
from thermal_comp.diagnosis.evidence.generic_regressors import GenericRegressor
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.line_amplitude import courses_of_lines
from thermal_comp.linear.gaussian_evidence import ConditionedDesign, log_sum

LEAST_UNNAMED_WAYS = 4
"""Number of ways, at least, in which an unnamed cause may act: the prior is shared by them."""


@dataclass(frozen=True)
class Remainder:
    """What may act beside the effects of a set: a flaw, a law without a name, a lost channel."""

    kind: str
    depends_on: str | None
    log_weight: float
    believed: Names = ()
    """Effects of the set that act as well where it has no name. A law that is not in the catalogue
    may look like any of them in part: then none is believed."""
    size: float = 0.0
    """√Δχ² that it explains."""
    course: bool = False
    """Whether all that is known is that runs share a course over time."""


def remainders(hypotheses: SensorHypotheses, one: FittedSet, flaw: float) -> list[Remainder]:
    """Return what may act beside the effects of a set: nothing, a flaw, something unknown."""
    some, state = one.set, one.state
    whole = some.beside(hypotheses.known)
    found = [Remainder('', None, exact_weight(hypotheses, some))]
    if may_be_flawed(hypotheses, some):
        found.append(Remainder('flaw', None, flaw))
    strongest = float(np.sqrt(whole.explained)) if whole.components else None
    amplitude = priors.amplitude_log_prior(strongest, priors.UNNAMED_RATIO_LN)
    gains = _log_gains(hypotheses, some, state, amplitude)
    lines = courses_of_lines(hypotheses, some.components)
    beside = hypotheses.conditioned(some.components) if lines else state
    measured = [r for r in hypotheses.regressors if r.depends_on in own_variables(whole)]
    if measured:
        own_error = priors.flaw_log_prior(float(np.sqrt(whole.explained)))
        errors = [FlexibleFunction(r.term, own_error) for r in measured]
        # Where it comes and goes a line lacks as much as it is.
        errors += [FlexibleFunction(line.own, amplitude) for line in lines]
        each = [gain_of(beside, error)[0] for error in errors]
        share = float(np.log(priors.CHANNEL_FLAWED_PROBABILITY / len(errors)))
        found.append(Remainder('flaw', None, log_sum(each) + share))
    gains = [
        (r, gain) for r, gain in gains if r.unlogged or r.depends_on not in one.variables_of_larger
    ]
    gains += [
        (replace(r, term=term), gain_of(beside, FlexibleFunction(term, amplitude))[0])
        for r in hypotheses.regressors
        if r.depends_on == 'frequency'
        for term in (line.of_others for line in lines)
        if term
    ]
    course = one.course + log_prior_at(one.course_size, amplitude)
    weight = log_sum([b.log_weight for b in found])
    found += _unnamed_causes(hypotheses, some, gains, course)
    found += _common_cause_of_steps(hypotheses, some, found)
    found += _unseen_twins(hypotheses, some, weight)
    return found + _other_causes(some, weight)


def _unnamed_causes(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    gains: Sequence[tuple[GenericRegressor, float]],
    course: float,
) -> list[Remainder]:
    """Return what speaks for a law that is not in the catalogue, and for a lost channel.

    A lost channel betrays itself by the trace it leaves in others. What follows time may be
    either, as may what follows the phase of the cycle, where a machine is likelier.
    """
    once = priors.ANOTHER_EFFECT_PROBABILITY
    if not some.beside(hypotheses.known).components:
        once = (1.0 - priors.NOTHING_PROBABILITY) / priors.NOTHING_PROBABILITY
    lost = hypotheses.lost_over_time
    laws = [Remainder(NOT_IN_CATALOGUE, r.depends_on, g) for r, g in gains if r.may_be_law]
    laws += [Remainder(NOT_IN_CATALOGUE, 'time', course, course=True)]
    traces = [Remainder(UNLOGGED, r.unlogged, g) for r, g in gains if r.unlogged]
    either = [Remainder(UNLOGGED, r.suspect, g) for r, g in gains if r.suspect]
    either += [Remainder(UNLOGGED, lost, course, course=True)] if lost else []
    found = []
    for beside, prior, ways in (
        (laws, priors.NOT_IN_CATALOGUE_PROBABILITY, len(laws)),
        (traces, priors.UNLOGGED_PROBABILITY, len(traces)),
        (either, priors.UNLOGGED_PROBABILITY * priors.WITHOUT_TRACE_PROBABILITY, len(laws)),
    ):
        share = float(np.log(prior * once / max(ways, LEAST_UNNAMED_WAYS)))
        found += [
            replace(b, log_weight=b.log_weight + share, size=size_of_gain(b.log_weight))
            for b in beside
        ]
    return _with_effects_of_lost_channel(hypotheses, some, found)


def _with_effects_of_lost_channel(
    hypotheses: SensorHypotheses, some: EffectSet, found: Sequence[Remainder]
) -> list[Remainder]:
    """Return what may act: beside a lost channel each effect of a set acts, or is a part of it.

    Steps and lines are a part of it: a lost channel would make them.
    """
    effects = {
        c.name: _own_size(hypotheses, some, c)
        for c in some.components
        if not c.form.effect.guessed_channel
        and not c.form.effect.repeatable
        and c.form.effect.line_frequency is None
    }
    parted = [b for b in found if b.kind != UNLOGGED]
    for b in found:
        if b.kind != UNLOGGED:
            continue
        lost = {n: priors.probability_of_lost(s / max(b.size, 1.0)) for n, s in effects.items()}
        for acting in _subsets(sorted(lost)):
            share = np.prod([1.0 - p if name in acting else p for name, p in lost.items()])
            weight = b.log_weight + float(np.log(max(share, 1e-300)))
            parted.append(replace(b, log_weight=weight, believed=acting))
    return parted


def _own_size(hypotheses: SensorHypotheses, some: EffectSet, one: Component) -> float:
    """Return √Δχ² that one effect of a set explains beside the others."""
    others = [c for c in some.components if c is not one]
    left = hypotheses.explained(others, some.components)
    return float(np.sqrt(max(hypotheses.explained(some.components) - left, 0.0)))


def _subsets(names: Sequence[str]) -> Iterator[Names]:
    """Yield every choice of some names, none and all among them."""
    return chain.from_iterable(combinations(names, count) for count in range(len(names) + 1))


def _common_cause_of_steps(
    hypotheses: SensorHypotheses, some: EffectSet, found: Sequence[Remainder]
) -> list[Remainder]:
    """Return what speaks for one cause of the several steps of a set, beside what was `found`.

    A lost channel that is switched makes as many steps as it likes, and so does a sensor whose
    bias jumps between levels by itself (random telegraph noise), which is no effect. Of the two
    without a name that act together the lost channel is told.
    """
    name, steps = max(Counter(some.names).items(), key=lambda pair: pair[1], default=('', 0))
    if steps < 2:
        return []
    size = len(some.names)
    once = hypotheses.log_prior(size - steps + 1) - hypotheses.log_prior(size)
    jumps = priors.NOT_IN_CATALOGUE_PROBABILITY * priors.JUMPS_BY_ITSELF_PROBABILITY
    causes = [(NOT_IN_CATALOGUE, 'time', jumps)]
    if lost := hypotheses.lost_over_time:
        causes.append((UNLOGGED, lost, priors.UNLOGGED_PROBABILITY))
    known = _names_without(some, name)
    return [
        replace(
            b if b.kind == UNLOGGED else Remainder(kind, channel, b.log_weight),
            log_weight=b.log_weight + once + float(np.log(probability)),
            believed=known
            if b.kind in {'', 'flaw'}
            else tuple(n for n in b.believed if n != name),
        )
        for kind, channel, probability in causes
        for b in found
    ]


def _unseen_twins(hypotheses: SensorHypotheses, some: EffectSet, weight: float) -> list[Remainder]:
    """Return effects whose channel was not logged, in place of those of a set they look like.

    What cannot be told from an effect is as likely as the set with that one; `weight`: the set's.
    """
    share = weight + float(np.log(priors.UNSEEN_TWIN_ODDS))
    lost = hypotheses.without_channel
    return [
        Remainder(UNLOGGED, lost[twin], share, _names_without(some, c.name))
        for c in some.components
        if (twin := c.form.effect.twin) in lost
    ]


def _other_causes(some: EffectSet, weight: float) -> list[Remainder]:
    """Return what speaks for another cause of an effect of a set; `weight`: the set's."""
    share = weight + float(np.log(priors.ANY_CAUSE_ODDS))
    effects = [c.form.effect for c in some.components if c.form.effect.of_any_cause]
    return [
        Remainder(
            NOT_IN_CATALOGUE,
            'time' if e.line_frequency is None else 'frequency',
            share,
            _names_without(some, e.name),
        )
        for e in effects
    ]


def _log_gains(
    hypotheses: SensorHypotheses,
    some: EffectSet,
    state: ConditionedDesign,
    amplitude: FloatArray,
) -> list[tuple[GenericRegressor, float]]:
    """Return by generic regressor ln of the evidence it adds; the best with others beside it."""
    regressors = hypotheses.regressors
    functions = [
        FlexibleFunction(r.term, amplitude - log_places(r, some), beside=False) for r in regressors
    ]
    gains = gains_together(hypotheses, some, state, functions)
    return list(zip(regressors, gains, strict=True))


def as_unlogged(
    hypotheses: SensorHypotheses, some: EffectSet, rest: list[Remainder]
) -> list[Remainder]:
    """Return what acts beside a set; of a guessed channel its own weight counts as `unlogged`."""
    guesses = [c for c in some.components if c.form.effect.guessed_channel]
    if not guesses:
        return rest
    own = {'', 'flaw'}
    share = float(np.log(priors.GUESSED_COURSE_PROBABILITY))
    size = max(_own_size(hypotheses, some, guess) for guess in guesses)
    lost = [
        replace(
            b, kind=UNLOGGED, depends_on=some.guessed, log_weight=b.log_weight + share, size=size
        )
        for b in rest
        if b.kind in own
    ]
    others = [b for b in rest if b.kind not in own]
    return others + _with_effects_of_lost_channel(hypotheses, some, lost)


def own_variables(some: EffectSet) -> set[str]:
    """Return what the effects of a set follow: channels, and 'frequency' for a spectral line."""
    effects = [one.form.effect for one in some.components]
    channels = {channel_label(c) for effect in effects for c in effect.needs}
    lines = [effect for effect in effects if effect.line_frequency is not None]
    return channels | ({'frequency'} if lines else set())


def _names_without(some: EffectSet, name: str = '') -> Names:
    """Return the effects of a set without those of one name, or of a channel that is guessed."""
    own = (c for c in some.components if not c.form.effect.guessed_channel)
    return tuple(sorted(c.name for c in own if c.name != name))
