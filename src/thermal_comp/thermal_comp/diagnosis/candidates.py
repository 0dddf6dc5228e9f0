# SPDX-License-Identifier: Apache-2.0
"""The forms of every effect that a diagnosis tries: shape parameters on a grid, then moved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.spectral_lines import spectral_lines
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import ColumnBank, Term

CANDIDATES = 2
"""Steps per run that are handed on."""
APART_S = 1200.0
"""Least distance of two of them [s]."""


def step_times(bank: ColumnBank) -> list[tuple[int, float]]:
    """Return run and time [s] of the likeliest steps, each run's strongest first.

    A step at row t is the column H_t = (0 … 0, 1 … 1); with W the whitening filter its product
    with the residual r is H_tᵀ Wᵀ W r, a sum over the rows from t on. Its norm hardly depends on
    t, as a whitening filter soon forgets a step.
    """
    found = []
    for number, run in enumerate(bank.source.runs):
        time = run.time[bank.valid[number]]
        response = np.cumsum(bank.transposed(number)[::-1], axis=0)[::-1]
        strength: FloatArray = (response**2).sum(axis=1)
        for _ in range(CANDIDATES):
            at = int(np.argmax(strength))
            if not 0 < at < len(time) or strength[at] <= 0.0:
                break
            found.append((number, float(0.5 * (time[at - 1] + time[at]))))
            strength[np.abs(time - time[at]) < APART_S] = 0.0
    return found


TIME_CONSTANTS = np.geomspace(20.0, 7000.0, 18)
"""Lags tried [s]; a faster one is the rate of change, as far as block means can tell."""
CREEP_TIMES = np.geomspace(60.0, 8000.0, 6)
"""Times of creep tried [s]; a slower one is a drift, as far as a run of some hours can tell."""
SEARCHED = {
    ('thermal_lag', 'time_constant'): (20.0, 3600.0),
    ('thermal_lag_two_stage', 'time_constant_fast'): (20.0, 600.0),
    ('bias_creep', 'time_constant'): (30.0, 8000.0),
}
"""Bounds of the search where they are closer than the parameter's own."""
HALF_WIDTHS = np.geomspace(0.8, 28.0, 13)
"""Half-widths of plays tried [K]."""
STEP_SPACING_S = 1200.0
"""Distance of the step times tried [s]."""


@dataclass(frozen=True)
class Form:
    """One effect with given shape parameters, as terms of a bank."""

    effect: Effect
    terms: tuple[Term, ...]
    free: int
    """Number of shape parameters that were searched."""


@dataclass(frozen=True)
class Family:
    """All forms of one effect."""

    name: str
    forms: tuple[Form, ...]


@dataclass(frozen=True)
class Plan:
    """A form before its columns are computed."""

    effect: Effect
    parts: tuple[Effect, ...]
    """Effects whose columns together are the form's."""
    free: int
    run: int | None = None
    """The run whose column alone is taken."""


def families(bank: ColumnBank, catalogue: Mapping[str, type[Effect]]) -> list[Family]:
    """Return the families of the catalogue whose channels were logged in every run."""
    planned = plans(bank, catalogue)
    bank.terms([part for some in planned.values() for plan in some for part in plan.parts])
    return [
        Family(name, tuple(_form(bank, plan) for plan in some)) for name, some in planned.items()
    ]


def plans(bank: ColumnBank, catalogue: Mapping[str, type[Effect]]) -> dict[str, list[Plan]]:
    """Return the forms of each family before their columns are computed; none is empty."""
    planned = {
        name: _PLANNERS.get(name, _grid)(bank, effect)
        for name, effect in catalogue.items()
        if name != 'bias_temperature' and usable(effect, bank.sensor, bank.source.runs)
    }
    return {name: some for name, some in planned.items() if some}


def _form(bank: ColumnBank, plan: Plan) -> Form:
    terms = tuple(bank.terms(plan.parts))
    if plan.run is not None:
        terms = tuple(Term((term.columns[plan.run],)) for term in terms)
    return Form(plan.effect, terms, plan.free)


def usable(effect: type[Effect], sensor: Sensor, runs: Sequence[PreparedRun]) -> bool:
    """Tell whether the effect acts on the sensor and its channels were logged in every run."""
    return sensor in effect.sensors and not missing_channels(effect, runs)


def missing_channels(effect: type[Effect], runs: Sequence[PreparedRun]) -> list[str]:
    """Return the channels the effect needs that some run lacks."""
    return [c for c in effect.channels if not all(run.conditions.has(c) for run in runs)]


def shape_grid(effect: type[Effect], points: int = 9) -> list[Effect]:
    """Return the effect on a grid of its shape parameters, geometric between their bounds."""
    forms: list[Effect] = [effect()]
    for item in fields(effect):
        low, high = item.metadata['bounds']
        if item.metadata['unit'] == '1' or isinstance(item.default, tuple):
            continue
        low = max(low, 1e-4 * high)
        values = np.geomspace(low, high, points)
        forms = [replace(form, **{item.name: float(v)}) for form in forms for v in values]
    return forms


def _grid(_: ColumnBank, effect: Any) -> list[Plan]:
    return _single(shape_grid(effect))


def _single(effects: Sequence[Effect]) -> list[Plan]:
    return [Plan(effect, (effect,), _free(effect)) for effect in effects]


def _free(effect: Effect) -> int:
    values = effect.shape_parameters.values()
    return sum(len(v) if isinstance(v, tuple) else 1 for v in values)


def _lags(_: ColumnBank, effect: Any) -> list[Plan]:
    return _single([effect(float(t)) for t in TIME_CONSTANTS if t <= 3600.0])


def _two_lags(_: ColumnBank, effect: Any) -> list[Plan]:
    lag: Any = EFFECTS['thermal_lag']
    return [
        Plan(effect(fast, slow), (lag(fast), lag(slow)), 2)
        for fast, slow in combinations(TIME_CONSTANTS.tolist(), 2)
        if slow > 2.5 * fast and fast <= 600.0 and slow >= 120.0
    ]


def _plays(_: ColumnBank, effect: Any) -> list[Plan]:
    widths = HALF_WIDTHS.tolist()
    chosen: list[tuple[float, ...]] = [(width,) for width in widths]
    for count in (2, 3):
        chosen += [some for some in combinations(widths, count) if _spread(some)]
    chosen += [tuple(widths[k] for k in (1, 4, 7, 10)), tuple(widths[k] for k in (3, 6, 8, 10))]
    return [Plan(effect(some), tuple(effect((r,)) for r in some), len(some)) for some in chosen]


def _spread(widths: Sequence[float]) -> bool:
    return all(wide > 1.7 * narrow for narrow, wide in pairwise(widths))


def _warm_ups(_: ColumnBank, effect: Any) -> list[Plan]:
    return _single([effect(float(t)) for t in np.geomspace(60.0, 7200.0, 10)])


def _creeps(_: ColumnBank, effect: Any) -> list[Plan]:
    return _single([effect(float(t)) for t in CREEP_TIMES])


def _ice(_: ColumnBank, effect: Any) -> list[Plan]:
    grow, melt = np.geomspace(300.0, 10_000.0, 6), np.geomspace(60.0, 2500.0, 7)
    return _single([effect(float(g), float(m)) for g in grow for m in melt])


def _cycle_levels(bank: ColumnBank, effect: Any) -> list[Plan]:
    cycles = max(int(run.cycle.max()) for run in bank.source.runs)
    if cycles < 2:
        return []
    return [
        Plan(levels, (levels,), 0) for levels in (effect(float(cycles), f) for f in (2.0, 1.0))
    ]


def _steps(bank: ColumnBank, effect: Any) -> list[Plan]:
    last = max(float(run.time[-1]) for run in bank.source.runs)
    plans = []
    for time in np.arange(STEP_SPACING_S, last, STEP_SPACING_S):
        step = effect((float(time),))
        plans.append(Plan(step, (step,), 1))
        plans += [Plan(step, (step,), 1, run) for run in range(len(bank.source.runs))]
    for run, at in step_times(bank):
        step = effect((at,))
        plans.append(Plan(step, (step,), 1, run))
    return plans


def _lines(bank: ColumnBank, effect: Any) -> list[Plan]:
    return _single([effect(f) for f in spectral_lines(bank.source.runs, bank.sensor)])


_PLANNERS: dict[str, Callable[[ColumnBank, Any], list[Plan]]] = {
    'thermal_lag': _lags,
    'thermal_lag_two_stage': _two_lags,
    'thermal_hysteresis': _plays,
    'warm_up': _warm_ups,
    'bias_creep': _creeps,
    'icing': _ice,
    'turn_on_bias': _cycle_levels,
    'bias_step': _steps,
    'mains_alias': _lines,
}
"""Effects whose forms are not simply a grid over their bounds."""


STEP_TIME_S = 400.0
"""A factor of 1.25 moves a step in time by this [s]."""
LINE_HZ = 2e-5
"""A factor of 1.25 moves a line by this [Hz]."""


def moved_forms(bank: ColumnBank, form: Form, ratio: float) -> list[Form]:
    """Return the form with each shape parameter moved up and down, within its bounds."""
    effects = list(_moved(form.effect, ratio))
    terms = bank.terms(effects)
    single = len(form.terms) == 1 and len(form.terms[0].columns) < len(terms[0].columns)
    if single:
        first = bank.term(form.effect).columns.index(form.terms[0].columns[0])
        terms = [Term((term.columns[first],)) for term in terms]
    return [Form(e, (t,), form.free) for e, t in zip(effects, terms, strict=True)]


def _moved(effect: Effect, ratio: float) -> Iterator[Effect]:
    for item in fields(effect):
        value: Any = getattr(effect, item.name)
        low, high = SEARCHED.get((effect.name, item.name), item.metadata['bounds'])
        if item.metadata['unit'] == '1':
            continue
        several = isinstance(value, tuple)
        values = value if several else (value,)
        for k, number in enumerate(values):
            for moved in _steps_diagnose_shapes(item.name, float(number), ratio):
                if low <= moved <= high:
                    new = (*values[:k], moved, *values[k + 1 :])
                    yield replace(effect, **{item.name: new if several else moved})


def _steps_diagnose_shapes(name: str, number: float, ratio: float) -> tuple[float, float]:
    share = (ratio - 1.0) / 0.25
    if name == 'step_time':
        return number + STEP_TIME_S * share, number - STEP_TIME_S * share
    if name == 'frequency':
        return number + LINE_HZ * share, number - LINE_HZ * share
    return number * ratio, number / ratio
