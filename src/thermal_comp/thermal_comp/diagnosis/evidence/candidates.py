# SPDX-License-Identifier: Apache-2.0
"""The forms of every effect that a diagnosis tries: shape parameters on a grid, then moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.acting_channels import channel_label
from thermal_comp.data.conditions import Sensor, logged_channels
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import frequencies_told_apart
from thermal_comp.data.time_scale import time_scale
from thermal_comp.effects.effect import Campaign, Candidate, Effect, shape_bounds
from thermal_comp.effects.operators import rise
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup

STEPS_PER_RUN = 2
"""Steps per run that are handed on."""
STEP_PLACES = 9
"""Places that are tried about a likely step, at first from a block before to one after."""
STEP_ROUNDS = 3
"""Rounds of such trials, each between the neighbours of the best place of the one before."""
STEP_DURATIONS_S = (0.0, 5.0, 15.0, 45.0, 135.0)
"""How long a step may last [s]."""
STEP_DISTANCE_S = 1200.0
"""Least distance of two of them [s]."""


@dataclass(frozen=True)
class Form:
    """One effect with given shape parameters, as terms of a design."""

    effect: Effect
    terms: tuple[ColumnGroup, ...]
    run: int | None = None
    """The only run in which it acts; None: in all."""
    relative: tuple[float, ...] = ()
    """By column, prior deviation of its coefficient [√Δχ²] over that of its largest one."""

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the design."""
        return tuple(c for term in self.terms for c in term.columns)

    @property
    def free(self) -> int:
        """Number of shape parameters that were searched."""
        return self.effect.free_shapes


@dataclass(frozen=True)
class Family:
    """All forms of one effect."""

    effect: type[Effect]
    forms: tuple[Form, ...]

    @property
    def name(self) -> str:
        """Catalogue name of the effect."""
        return self.effect.name

    @cached_property
    def variants(self) -> dict[tuple[float, ...], list[Form]]:
        """The forms of each variant of the effect."""
        found: dict[tuple[float, ...], list[Form]] = {}
        for form in self.forms:
            found.setdefault(form.effect.variant, []).append(form)
        return found

    @cached_property
    def alike(self) -> list[list[Form]]:
        """The forms in groups of one variant and as many columns."""
        groups: dict[tuple[object, int], list[Form]] = {}
        for variant, forms in self.variants.items():
            for form in forms:
                groups.setdefault((variant, len(form.columns)), []).append(form)
        return [*groups.values()]


def alternatives(design: CandidateDesign, family: Family, form: Form) -> int:
    """Return one over the prior of a form: variants are equally likely, and forms of each.

    Of a spectral line that of its frequency, wherever lines stand out.
    """
    if form.effect.line_frequency is not None:
        return frequencies_told_apart(design.source.runs)
    return len(family.variants) * len(family.variants[form.effect.variant])


def families(design: CandidateDesign, catalogue: Mapping[str, type[Effect]]) -> list[Family]:
    """Return the families of the catalogue whose channels were logged in every run."""
    tried = candidates(design, catalogue, campaign_of(design))
    design.terms([part for some in tried.values() for c in some for part in c.effect.parts()])
    made = [
        Family(catalogue[name], tuple(form_of(design, c.effect, c.run) for c in some))
        for name, some in tried.items()
    ]
    # Terms of one form stand beside each other in every hypothesis: their products come at once.
    for form in (form for family in made for form in family.forms if len(form.terms) > 1):
        design.equations(form.columns)
    return made


def guesses(design: CandidateDesign, catalogue: Mapping[str, type[Effect]]) -> list[Family]:
    """Return the families of effects whose channel is guessed because no run logged it."""
    runs = design.source.runs
    searched = [effect for effect in catalogue.values() if effect.searched]
    lacking = [
        guess
        for effect in searched
        if (guess := effect.guess())
        and all(effect.lacking(logged_channels([run.conditions])) for run in runs)
    ]
    return families(design, {guess.name: guess for guess in lacking})


def candidates(
    design: CandidateDesign, catalogue: Mapping[str, type[Effect]], campaign: Campaign
) -> dict[str, list[Candidate]]:
    """Return the forms of each effect before their columns are computed; none is empty."""
    tried = {
        name: effect.search_grid(campaign)
        for name, effect in catalogue.items()
        if effect.searched and usable(effect, design.sensor, design.source.runs)
    }
    return {name: some for name, some in tried.items() if some}


def renewed(design: CandidateDesign, family: Family, known: Sequence[Form]) -> Family:
    """Return a family with the forms that are chosen from what known forms leave.

    A step is not seen beneath larger ones until they are taken out.
    """
    campaign = replace(
        campaign_of(design, [term for form in known for term in form.terms]),
        occurred=[(form.run, time) for form in known for time in form.effect.occurrences],
    )
    grid = family.effect.search_grid(campaign)
    return Family(family.effect, tuple(form_of(design, c.effect, c.run) for c in grid))


def campaign_of(design: CandidateDesign, known: Sequence[ColumnGroup] = ()) -> Campaign:
    """Return what the runs, and what known terms leave, offer to choose forms from."""
    runs = design.source.runs
    return Campaign(
        cycles=max(int(run.cycle.max()) for run in runs),
        durations=tuple(float(run.time[-1]) for run in runs),
        times_before=tuple(run.conditions.time_before for run in runs),
        spectral_lines=partial(design.source.spectral_lines, design.sensor),
        step_times=partial(step_times, design, known),
        channels=logged_channels([run.conditions for run in runs]),
    )


def _time_scale(design: CandidateDesign) -> float:
    return time_scale(max(float(run.time[-1]) for run in design.source.runs))


def step_times(
    design: CandidateDesign, known: Sequence[ColumnGroup] = ()
) -> list[tuple[int, float, float]]:
    """Return run, time and duration [s] of the likeliest steps beside known terms.

    A step at row t is the column H_t = (0 … 0, 1 … 1); with W the whitening filter its product
    with the residual r is H_tᵀ Wᵀ W r, a sum over the rows from t on. Its norm hardly depends on
    t, as a whitening filter soon forgets a step.
    """
    found = []
    residual = design.residual(known)
    distance = _time_scale(design) * STEP_DISTANCE_S
    for number, run in enumerate(design.source.runs):
        time = run.time[design.valid[number]]
        response = np.cumsum(design.transposed(number, residual)[::-1], axis=0)[::-1]
        strength: FloatArray = (response**2).sum(axis=1)
        for _ in range(STEPS_PER_RUN):
            at = int(np.argmax(strength))
            if not 0 < at < len(time) or strength[at] <= 0.0:
                break
            middle = float(0.5 * (time[at - 1] + time[at]))
            found.append((number, *_likeliest_rise(design, residual, number, middle)))
            strength[np.abs(time - time[at]) < distance] = 0.0
    return found


def _likeliest_rise(
    design: CandidateDesign, residual: FloatArray, number: int, middle: float
) -> tuple[float, float]:
    """Return start and duration [s] of the step near a time that explains most of a residual."""
    run = design.source.runs[number]
    durations = _time_scale(design) * np.array(STEP_DURATIONS_S)
    middles = np.full(len(durations), middle)
    reach = run.period
    for _ in range(STEP_ROUNDS):
        tried = middles[:, None] + reach * np.linspace(-1.0, 1.0, STEP_PLACES)
        starts = np.maximum(tried - 0.5 * durations[:, None], 0.0)
        forms = list(
            zip(starts.ravel().tolist(), np.repeat(durations, STEP_PLACES).tolist(), strict=True)
        )
        delta_chi2 = _delta_chi2(design, residual, number, forms).reshape(tried.shape)
        middles = tried[np.arange(len(tried)), delta_chi2.argmax(axis=1)]
        reach *= 2.0 / (STEP_PLACES - 1)
    start, duration = forms[int(delta_chi2.argmax())]
    return start, float(duration)


def _delta_chi2(
    design: CandidateDesign,
    residual: FloatArray,
    number: int,
    forms: Sequence[tuple[float, float]],
) -> FloatArray:
    """Return (k,) Δχ² that steps of k starts and durations in a run explain of a residual."""
    first, columns = _rises(design.source.runs[number], forms)
    delta_chi2: FloatArray = np.zeros(len(forms))
    for axis in range(3):
        white, rows = design.whitened_in_run(columns, number, axis, first)
        power = (white**2).sum(axis=0) - ((design.base[axis][rows].T @ white) ** 2).sum(axis=0)
        delta_chi2 += (white.T @ residual[axis, rows]) ** 2 / np.maximum(power, 1e-9)
    return delta_chi2


def _rises(run: PreparedRun, forms: Sequence[tuple[float, float]]) -> tuple[int, FloatArray]:
    """Return the first block that any of k rises reaches, and their (…, k) means from it on.

    They are one in the blocks after the last rise.
    """
    time, starts = run.conditions.time, run.starts
    begin, end = np.searchsorted(time, [min(s for s, _ in forms), max(s + d for s, d in forms)])
    first = int(np.searchsorted(starts[:, 1], begin, side='right'))
    last = max(int(np.searchsorted(starts[:, 0], end, side='right')), first + 1)
    near = replace(run, starts=starts[first:last] - starts[first, 0])
    fine = time[starts[first, 0] : starts[last - 1, 1]]
    means = np.ones((len(run) - first, len(forms)))
    means[: last - first] = near.block_mean(np.stack([rise(fine, *f) for f in forms], axis=1))
    return first, means


def form_of(design: CandidateDesign, effect: Effect, run: int | None) -> Form:
    """Return an effect with its terms in the design, those of one run or all."""
    terms = tuple(design.terms(effect.parts()))
    if run is not None:
        terms = tuple(ColumnGroup((term.columns[run],)) for term in terms)
    sizes = np.concatenate([design.size_of(term) for term in terms])
    return Form(effect, terms, run, _relative(effect.coefficient_units, sizes))


def _relative(units: Sequence[str], sizes: FloatArray) -> tuple[float, ...]:
    """Return prior deviations [√Δχ²] of the coefficients of columns (p,) over the largest of them.

    Coefficients of one unit are equally large beforehand: a lag of a minute explains less than
    one of an hour. Those of several units have no such scale.
    """
    largest = float(sizes.max(initial=0.0))
    alike = len(set(units)) == 1 and largest > 0.0
    return tuple((sizes / largest).tolist()) if alike else (1.0,) * len(sizes)


def usable(effect: type[Effect], sensor: Sensor, runs: Sequence[PreparedRun]) -> bool:
    """Tell whether the effect acts on the sensor and its channels were logged in every run."""
    return sensor in effect.sensors and not missing_channels(effect, runs)


def missing_channels(effect: type[Effect], runs: Sequence[PreparedRun]) -> list[str]:
    """Return the channels the effect needs that some run lacks."""
    return effect.lacking(logged_channels([run.conditions for run in runs]))


def channels_not_logged(
    design: CandidateDesign, catalogue: Mapping[str, type[Effect]]
) -> dict[str, str]:
    """Return the effects of the sensor that cannot be tried, each with a channel it lacks."""
    runs = design.source.runs
    lacking = {
        name: missing_channels(effect, runs)
        for name, effect in catalogue.items()
        if effect.searched and design.sensor in effect.sensors
    }
    return {name: channel_label(channels[0]) for name, channels in lacking.items() if channels}


def moved_forms(
    design: CandidateDesign, form: Form, ratio: float, ways: Sequence[Sequence[float]]
) -> list[Form | None]:
    """Return the form with its shape parameters moved, None where that leaves what is searched.

    Each of `ways` says by what power of `ratio` every parameter is multiplied.
    """
    scale = _time_scale(design)
    effects = [_moved(form.effect, ratio, way, scale) for way in ways]
    design.terms([part for effect in effects if effect for part in effect.parts()])
    return [None if e is None else form_of(design, e, form.run) for e in effects]


def _moved(effect: Effect, ratio: float, powers: Sequence[float], scale: float) -> Effect | None:
    left = iter(powers)
    changed: dict[str, Any] = {}
    for item in effect.free_parameters:
        value: Any = getattr(effect, item.name)
        low, high = shape_bounds(item, scale, searched=True)
        step = item.metadata.get('step')
        several = isinstance(value, tuple)
        new = tuple(
            float(f'{_neighbour(float(number), ratio, step, next(left)):.12g}')
            for number in (value if several else (value,))
        )
        if not all(low <= number <= high for number in new):
            return None
        changed[item.name] = new if several else new[0]
    moved = replace(effect, **changed)
    return moved if moved.stages_are_apart else None


def _neighbour(number: float, ratio: float, step: float | None, power: float) -> float:
    if step is None:
        return float(number * ratio**power)
    return number + power * step * (ratio - 1.0) / 0.25
