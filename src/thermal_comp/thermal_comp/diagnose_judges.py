# SPDX-License-Identifier: Apache-2.0
"""Functions without physics that ask on which variable a residual depends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from imu_recording.recording import FloatArray
from scipy.interpolate import BSpline

from thermal_comp.diagnose_bank import ColumnBank, Term
from thermal_comp.prepared_run import PreparedRun
from thermal_comp.saturated_model import lagged

SMOOTHING_S = 120.0
"""Time constant of the temperature rate's sign [s]."""


@dataclass(frozen=True)
class Judge:
    """A flexible function of one variable."""

    depends_on: str
    name: str
    term: Term


def judges(bank: ColumnBank) -> list[Judge]:
    """Return the judges for the variables that were logged."""
    runs = bank.source.runs
    spans = _spans(runs)
    made: list[tuple[str, str, Callable[[PreparedRun], FloatArray], bool]] = [
        ('temperature', 'curve over temperature', spans.temperature, False),
        ('branch', 'curve over temperature, one per branch', spans.branch, False),
        ('rate', 'curve over the temperature rate', spans.rate, False),
        ('time', 'curve over time', spans.time, False),
        ('time', 'curve over time, one per run', spans.time, True),
        ('time', 'slope over temperature that changes with time', spans.slope_in_time, False),
        ('orientation', 'curve over temperature, one per orientation', spans.parabola, True),
    ]
    if all(run.has_cycles for run in runs):
        made.append(('phase', 'curve over the phase of the cycle', spans.phase, False))
        made.append(('cycle', 'level and slope of each cycle', spans.cycle, False))
    for name in ('heater', 'compressor', 'supply_voltage', 'humidity'):
        if all(run.conditions.has(name) for run in runs):
            label = name.removesuffix('_voltage')
            made.append(
                (label, f'{label}, also times temperature', partial(spans.channel, name), False)
            )
    if all(run.conditions.has('vibration') for run in runs):
        made.append(('vibration', 'vibration and its square', spans.vibration, False))
    terms = bank.generic_terms([(function, per_run) for _, _, function, per_run in made])
    return [Judge(row[0], row[1], term) for row, term in zip(made, terms, strict=True)]


@dataclass(frozen=True)
class _Spans:
    """Ranges shared by all runs, so that one curve fits them together."""

    low: float
    high: float
    fastest: float
    longest: float
    cycle_length: float

    def temperature(self, run: PreparedRun) -> FloatArray:
        return _spline(run.temperature, self.low, self.high, 16)

    def branch(self, run: PreparedRun) -> FloatArray:
        curve = _spline(run.temperature, self.low, self.high, 8)
        rising = np.tanh(self._rate(run) / (0.1 * self.fastest))
        return np.concatenate([curve, curve * rising[:, None]], axis=1)

    def rate(self, run: PreparedRun) -> FloatArray:
        rate = self._rate(run)
        curve = _spline(rate, -self.fastest, self.fastest, 7)
        x = (run.temperature - run.conditions.reference_temperature) / 30.0
        slope = (rate / self.fastest * x)[:, None]
        return np.concatenate([curve, slope], axis=1)

    def time(self, run: PreparedRun) -> FloatArray:
        return _spline(run.time, 0.0, self.longest, 9)

    def slope_in_time(self, run: PreparedRun) -> FloatArray:
        x = run.conditions.reference_temperature
        return _spline(run.time, 0.0, self.longest, 4) * (run.temperature - x)[:, None]

    def parabola(self, run: PreparedRun) -> FloatArray:
        x = (run.temperature - run.conditions.reference_temperature) / 30.0
        return np.stack([x, x**2, x**3], axis=1)

    def phase(self, run: PreparedRun) -> FloatArray:
        since = _time_in_cycle(run)
        inside = (since >= 0.0) & (since <= self.cycle_length)
        curve = _spline(np.clip(since, 0.0, self.cycle_length), 0.0, self.cycle_length, 50)
        return curve * inside[:, None]

    def cycle(self, run: PreparedRun) -> FloatArray:
        numbers = [n for n in np.unique(run.cycle) if n > 0]
        member = (run.cycle[:, None] == numbers).astype(float)
        x = (run.temperature - run.conditions.reference_temperature) / 30.0
        return np.concatenate([member, member * x[:, None]], axis=1)

    def channel(self, name: str, run: PreparedRun) -> FloatArray:
        values = np.asarray(getattr(run.block_conditions, name))
        centred = values - values.mean()
        x = (run.temperature - run.conditions.reference_temperature) / 30.0
        return np.stack([centred, centred * x, centred * x**2, centred**2], axis=1)

    def vibration(self, run: PreparedRun) -> FloatArray:
        values = np.asarray(run.block_conditions.vibration)
        return np.concatenate([values, values**2], axis=1)

    @staticmethod
    def _rate(run: PreparedRun) -> FloatArray:
        slow = lagged(run.time, run.temperature, SMOOTHING_S)
        return np.asarray((run.temperature - slow) / SMOOTHING_S)


def _spans(runs: Sequence[PreparedRun]) -> _Spans:
    lengths = [_cycle_length(run) for run in runs if run.has_cycles]
    rates = [np.abs(_Spans._rate(run)).max() for run in runs]
    return _Spans(
        low=min(float(run.temperature.min()) for run in runs),
        high=max(float(run.temperature.max()) for run in runs),
        fastest=max(float(max(rates)), 1e-6),
        longest=max(float(run.time[-1]) for run in runs),
        cycle_length=max(lengths, default=1.0),
    )


def _time_in_cycle(run: PreparedRun) -> FloatArray:
    """(m,) time since the cycle began [s]; negative outside the cycles."""
    since = np.full(len(run), -1.0)
    for number in np.unique(run.cycle[run.cycle > 0]):
        inside = run.cycle == number
        since[inside] = run.time[inside] - run.time[inside][0]
    return since


def _cycle_length(run: PreparedRun) -> float:
    return float(max(_time_in_cycle(run).max(), 1.0))


def _spline(values: FloatArray, low: float, high: float, pieces: int) -> FloatArray:
    """(m, pieces + 2) quadratic B-splines between low and high."""
    if not high > low:
        return np.ones((len(values), 1))
    knots = np.concatenate([[low] * 2, np.linspace(low, high, pieces + 1), [high] * 2])
    clipped = np.clip(values, low, high)
    return np.asarray(BSpline.design_matrix(clipped, knots, 2).toarray())
