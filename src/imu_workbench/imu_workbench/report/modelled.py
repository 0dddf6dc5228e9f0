# SPDX-License-Identifier: Apache-2.0
"""Measured and modelled error of the runs as block means: dependence, fit, residual."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from imu_recording.recording import PHASES, FloatArray, IntArray
from numpy.typing import NDArray
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.model.values import ThermalModel
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS

from imu_workbench.report.series import line, rounded


@dataclass(frozen=True, eq=False)
class RunErrors:
    """Errors of one run as block means: what was measured above the run's level, and the model."""

    name: str
    device: str
    period: float
    """Length of a block [s]."""
    time: FloatArray
    """(m,) [s] since the first sample."""
    temperature: FloatArray
    """(m,) die [°C]."""
    phase: IntArray
    """(m,) index into PHASES; −1 unknown."""
    cycle: IntArray
    """(m,)"""
    measured: Mapping[str, FloatArray]
    """(m, 3) per sensor: block means minus the run's level at the reference temperature."""
    modelled: Mapping[str, FloatArray]
    """(m, 3) per sensor: the model's error."""

    def residual(self, sensor: str) -> FloatArray:
        """(m, 3) measured minus modelled, in the sensor's SI unit."""
        difference: FloatArray = self.measured[sensor] - self.modelled[sensor]
        return difference

    def in_phase(self, name: str) -> NDArray[np.bool_]:
        """(m,) the blocks of a phase."""
        selected: NDArray[np.bool_] = self.phase == PHASES.index(name)
        return selected


def errors_of_run(run: PreparedRun, model: ThermalModel) -> RunErrors:
    """Return the errors of a prepared run under a model.

    The level is the one fitted for this run; for a run the model has not seen it is the mean of
    what the model leaves.
    """
    measured: dict[str, Any] = {}
    modelled: dict[str, Any] = {}
    for sensor in SENSORS:
        if sensor not in model.sensors or not np.isfinite(run.measured[sensor]).any():
            continue
        part = model.sensors[sensor]
        error = run.block_mean(part.modelled_error(run.conditions.of(sensor))[0])
        level = part.levels.get(run.name)
        if level is None:
            level = np.nanmean(run.measured[sensor] - error, axis=0)
        measured[sensor], modelled[sensor] = run.measured[sensor] - level, error
    return RunErrors(
        name=run.name,
        device=run.device,
        period=run.period,
        time=run.time,
        temperature=run.temperature,
        phase=run.phase,
        cycle=run.cycle,
        measured=measured,
        modelled=modelled,
    )


TEMPERATURE_BIN_K = 2.0
"""Width of the temperature bins of the dependence [K]."""
HISTOGRAM_BINS = 48
SCATTER_POINTS = 350
"""Points of one axis and branch in the scatter of the fit."""


def dependence_content(runs: Sequence[RunErrors]) -> dict[str, Any]:
    """Return measured and modelled error against die temperature, per sensor and axis (Fig. 5)."""
    found: dict[str, Any] = {}
    for sensor in SENSORS:
        having = [run for run in runs if sensor in run.measured]
        if not having:
            continue
        temperature = np.concatenate([run.temperature for run in having])
        factor = DISPLAY_UNITS[sensor].factor
        measured = np.concatenate([run.measured[sensor] for run in having]) * factor
        modelled = np.concatenate([run.modelled[sensor] for run in having]) * factor
        centre, means, spread = binned(temperature, measured)
        _, line_means, _ = binned(temperature, modelled)
        found[sensor] = {
            'unit': DISPLAY_UNITS[sensor].unit,
            'temperature': rounded(centre),
            'axes': {
                axis: {
                    'measured': rounded(means[:, i]),
                    'spread': rounded(spread[:, i]),
                    'modelled': rounded(line_means[:, i]),
                }
                for i, axis in enumerate('xyz')
            },
        }
    return found


def binned(temperature: FloatArray, values: FloatArray) -> tuple[FloatArray, ...]:
    """Return mean temperature (k,), mean (k, 3) and standard deviation (k, 3) of the bins."""
    good = np.isfinite(values).all(axis=1) & np.isfinite(temperature)
    temperature, values = temperature[good], values[good]
    if not len(values):
        return np.empty(0), np.empty((0, 3)), np.empty((0, 3))
    place = np.floor(temperature / TEMPERATURE_BIN_K).astype(np.int64)
    _, place, count = np.unique(place, return_inverse=True, return_counts=True)
    mean = partial(_bin_mean, place, count)
    means = np.column_stack([mean(values[:, i]) for i in range(3)])
    squares = np.column_stack([mean((values[:, i] - means[place, i]) ** 2) for i in range(3)])
    return mean(temperature), means, np.sqrt(squares)


def _bin_mean(place: IntArray, count: IntArray, column: FloatArray) -> FloatArray:
    sums: FloatArray = np.bincount(place, weights=column) / count
    return sums


def fit_content(run: RunErrors) -> dict[str, Any]:
    """Return scatter, line and distributions of a run per sensor and axis (Fig. 6)."""
    found: dict[str, Any] = {}
    heating = np.gradient(run.temperature) > 0.0 if len(run.temperature) > 1 else np.zeros(1, bool)
    branch = {'heating': heating, 'cooling': ~heating}
    for sensor in run.measured:
        factor = DISPLAY_UNITS[sensor].factor
        measured = run.measured[sensor] * factor
        modelled = run.modelled[sensor] * factor
        residual = run.residual(sensor) * factor
        axes = {}
        for i, axis in enumerate('xyz'):
            good = np.isfinite(measured[:, i])
            points = {}
            for name, rows in branch.items():
                chosen = np.flatnonzero(good & rows)
                chosen = chosen[:: max(1, -(-len(chosen) // SCATTER_POINTS))]
                points[name] = {
                    'x': rounded(run.temperature[chosen], 4),
                    'y': rounded(measured[chosen, i], 4),
                }
            order = np.argsort(run.temperature[good])
            sampled = order[:: max(1, len(order) // 200)]
            axes[axis] = {
                'points': points,
                'model': {
                    'x': rounded(run.temperature[good][sampled], 4),
                    'y': rounded(modelled[good, i][sampled], 4),
                },
                'before': histogram(measured[:, i], run),
                'after': histogram(residual[:, i], run),
            }
        found[sensor] = {'unit': DISPLAY_UNITS[sensor].unit, 'axes': axes}
    return found


def histogram(values: FloatArray, run: RunErrors) -> dict[str, Any]:
    """Return counts per bin, split into cold dwell, hot dwell and the rest, and the normal fit."""
    good = np.isfinite(values)
    if not good.any():
        return {'centre': [], 'counts': {}, 'normal': [], 'mean': None, 'std': None}
    low, high = np.quantile(values[good], [0.0005, 0.9995])
    low, high = (low, high) if high > low else (low - 1e-9, high + 1e-9)
    edges = np.linspace(low, high, HISTOGRAM_BINS + 1)
    centre = (edges[:-1] + edges[1:]) / 2.0
    cold, hot = run.in_phase('dwell_cold'), run.in_phase('dwell_hot')
    parts = {'cold dwell': cold, 'hot dwell': hot, 'other': ~cold & ~hot}
    mean, std = float(values[good].mean()), float(values[good].std())
    width = (high - low) / HISTOGRAM_BINS
    bell = np.exp(-0.5 * ((centre - mean) / max(std, 1e-300)) ** 2)
    scale = good.sum() * width / (max(std, 1e-300) * np.sqrt(2.0 * np.pi))
    return {
        'centre': rounded(centre),
        'counts': {
            name: np.histogram(values[good & rows], edges)[0].tolist()
            for name, rows in parts.items()
        },
        'normal': rounded(scale * bell),
        'mean': mean,
        'std': std,
    }


def residual_content(
    run: RunErrors, floors: Mapping[str, FloatArray], *, points: int
) -> dict[str, Any]:
    """Return measured, modelled and residual error over time, and where it fails.

    `floors` are the noise floors (3,) per sensor, in SI units.
    """
    hours = run.time / 3600.0
    gap = 3.0 * run.period / 3600.0
    found: dict[str, Any] = {}
    for sensor in run.measured:
        factor = DISPLAY_UNITS[sensor].factor
        columns = {
            'measured': run.measured[sensor] * factor,
            'modelled': run.modelled[sensor] * factor,
            'residual': run.residual(sensor) * factor,
        }
        found[sensor] = {
            'unit': DISPLAY_UNITS[sensor].unit,
            'axes': {
                axis: {
                    name: line(hours, values[:, i], points=points, max_gap=gap)
                    for name, values in columns.items()
                }
                for i, axis in enumerate('xyz')
            },
            'where': failure_map(run, run.residual(sensor), floors[sensor]),
        }
    return found


def failure_map(run: RunErrors, residual: FloatArray, floor: FloatArray) -> dict[str, Any] | None:
    """Return how many times the noise floor the residual is, per phase and cycle.

    `residual` (m, 3) and `floor` (3,) in one unit; rms over the three axes.
    """
    return failure_map_of([(run, residual)], floor)


def failure_map_of(
    runs: Sequence[tuple[RunErrors, FloatArray]], floor: FloatArray
) -> dict[str, Any] | None:
    """Return the same over several runs together."""
    phase = np.concatenate([run.phase for run, _ in runs])
    cycle = np.concatenate([run.cycle for run, _ in runs])
    numbers = [int(n) for n in np.unique(cycle) if n > 0]
    phases = [p for i, p in enumerate(PHASES) if (phase[cycle > 0] == i).any()]
    if not numbers or not phases:
        return None
    known = floor > 0.0
    weighed = np.concatenate([r for _, r in runs])[:, known] / floor[known]
    good = np.isfinite(weighed).all(axis=1)
    square = np.mean(weighed**2, axis=1) if known.any() else np.full(len(phase), np.nan)
    cells = []
    for name in phases:
        row = []
        for number in numbers:
            inside = square[good & (phase == PHASES.index(name)) & (cycle == number)]
            row.append(float(np.sqrt(inside.mean())) if len(inside) else None)
        cells.append(row)
    return {'phases': phases, 'cycles': numbers, 'ratio': cells}
