# SPDX-License-Identifier: Apache-2.0
"""The forms of every effect that a diagnosis tries: shape parameters on a grid."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from thermal_comp.conditions import Sensor
from thermal_comp.diagnose_bank import ColumnBank, Term
from thermal_comp.diagnose_line import spectral_lines
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.prepared_run import PreparedRun

TIME_CONSTANTS = np.geomspace(12.0, 7000.0, 18)
"""Lags tried [s]."""
HALF_WIDTHS = np.geomspace(0.8, 28.0, 13)
"""Half-widths of plays tried [K]."""
STEP_SPACING_S = 600.0
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


def families(bank: ColumnBank, catalogue: Mapping[str, type[Effect]]) -> list[Family]:
    """Return the families of the catalogue whose channels were logged in every run."""
    runs = bank.source.runs
    found = []
    for name, effect in catalogue.items():
        if name != 'bias_temperature' and usable(effect, bank.sensor, runs):
            forms = _MAKERS.get(name, _grid_forms)(bank, effect)
            if forms:
                found.append(Family(name, tuple(forms)))
    return found


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


def _grid_forms(bank: ColumnBank, effect: Any) -> list[Form]:
    return _single_forms(bank, shape_grid(effect))


def _single_forms(bank: ColumnBank, effects: Sequence[Effect]) -> list[Form]:
    terms = bank.terms(effects)
    return [Form(e, (t,), _free(e)) for e, t in zip(effects, terms, strict=True)]


def _free(effect: Effect) -> int:
    values = effect.shape_parameters.values()
    return sum(len(v) if isinstance(v, tuple) else 1 for v in values)


def _lags(bank: ColumnBank, effect: Any) -> list[Form]:
    return _single_forms(bank, [effect(float(t)) for t in TIME_CONSTANTS if t <= 3600.0])


def _two_lags(bank: ColumnBank, effect: Any) -> list[Form]:
    lag: Any = EFFECTS['thermal_lag']
    single = bank.terms([lag(float(t)) for t in TIME_CONSTANTS])
    pairs = combinations(zip(TIME_CONSTANTS, single, strict=True), 2)
    return [
        Form(effect(float(fast), float(slow)), (a, b), 2)
        for (fast, a), (slow, b) in pairs
        if slow > 2.5 * fast and fast <= 600.0 and slow >= 120.0
    ]


def _plays(bank: ColumnBank, effect: Any) -> list[Form]:
    single = bank.terms([effect((float(r),)) for r in HALF_WIDTHS])
    widths = list(zip(HALF_WIDTHS, single, strict=True))
    chosen: list[tuple[tuple[float, Term], ...]] = [(w,) for w in widths]
    for count in (2, 3):
        chosen += [some for some in combinations(widths, count) if _spread(some)]
    chosen += [tuple(widths[k] for k in (1, 4, 7, 10)), tuple(widths[k] for k in (3, 6, 8, 10))]
    return [
        Form(effect(tuple(float(r) for r, _ in some)), tuple(t for _, t in some), len(some))
        for some in chosen
    ]


def _spread(widths: Sequence[tuple[float, Term]]) -> bool:
    return all(wide > 1.7 * narrow for (narrow, _), (wide, _) in pairwise(widths))


def _warm_ups(bank: ColumnBank, effect: Any) -> list[Form]:
    return _single_forms(bank, [effect(float(t)) for t in np.geomspace(60.0, 7200.0, 10)])


def _creeps(bank: ColumnBank, effect: Any) -> list[Form]:
    return _single_forms(bank, [effect(float(t)) for t in np.geomspace(60.0, 20_000.0, 6)])


def _ice(bank: ColumnBank, effect: Any) -> list[Form]:
    grid = [
        (g, m) for g in np.geomspace(300.0, 10_000.0, 6) for m in np.geomspace(60.0, 2500.0, 7)
    ]
    return _single_forms(bank, [effect(g, m) for g, m in grid])


def _cycle_levels(bank: ColumnBank, effect: Any) -> list[Form]:
    cycles = max(int(run.cycle.max()) for run in bank.source.runs)
    if cycles < 2:
        return []
    (form,) = _single_forms(bank, [effect(float(cycles))])
    return [Form(form.effect, form.terms, 0)]


def _steps(bank: ColumnBank, effect: Any) -> list[Form]:
    last = max(float(run.time[-1]) for run in bank.source.runs)
    times = np.arange(STEP_SPACING_S, last, STEP_SPACING_S)
    forms = []
    effects = [effect(float(t)) for t in times]
    for instance, term in zip(effects, bank.terms(effects), strict=True):
        forms.append(Form(instance, (term,), 1))
        forms += [Form(instance, (Term((column,)),), 1) for column in term.columns]
    return forms


def _lines(bank: ColumnBank, effect: Any) -> list[Form]:
    frequencies = spectral_lines(bank.source.runs, bank.sensor)
    return _single_forms(bank, [effect(f) for f in frequencies])


_MAKERS: dict[str, Callable[[ColumnBank, Any], list[Form]]] = {
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
