# SPDX-License-Identifier: Apache-2.0
"""How a sensor follows the temperature: its course, and the slope of that course."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.effects.operators import follow
from thermal_comp.linear.candidate_design import CandidateDesign
from thermal_comp.linear.columns import LEAST_NEW_LENGTH


@dataclass(frozen=True, eq=False)
class TemperatureCourse:
    """A cubic over temperature through r runs, each with its own level and line.

    Beside it stands the temperature's history, which a lag would else bend into it.
    """

    design: CandidateDesign
    low: float
    """Lowest temperature [°C] …"""
    span: float
    """… and the range above it [K]."""
    columns: Sequence[FloatArray]
    """(n, 2 r + 2 + h) of each run's fine rows: levels and lines, square, cube, history."""

    @classmethod
    def of(cls, design: CandidateDesign) -> TemperatureCourse:
        """Return that of a design's runs."""
        runs = design.source.smoothed
        low = min(float(run.temperature.min()) for run in runs)
        span = max(max(float(run.temperature.max()) for run in runs) - low, 1e-6)
        columns = []
        for number, run in enumerate(runs):
            x = (run.conditions.temperature - low) / span
            lines = np.zeros((len(x), 2 * len(runs)))
            lines[:, 2 * number : 2 * number + 2] = np.stack([np.ones_like(x), x], axis=1)
            columns.append(np.column_stack([lines, x**2, x**3, temperature_history(run)]))
        return cls(design, low, span, columns)

    @cached_property
    def _stacked(self) -> FloatArray:
        """(rows, 2 r + 2 + h) means of the columns over the valid blocks of all runs."""
        runs = zip(self.design.source.smoothed, self.columns, self.design.valid, strict=True)
        return np.concatenate([run.block_mean(columns)[ok] for run, columns, ok in runs])

    def coefficients(self, beside: FloatArray | None = None) -> FloatArray:
        """Return the coefficients (2 r + 2 + h, 3) of the columns along the design's axes.

        They are those of a ridge regression, as large as the priors of bends and of the
        thermometer's lag allow. `beside` (rows, 3, q): further columns of the valid blocks, whose
        coefficients are about one.
        """
        runs, stacked = self.design.source.smoothed, self._stacked
        pairs = zip(runs, self.design.valid, strict=True)
        measured = np.concatenate([run.measured[self.design.sensor][ok] for run, ok in pairs])
        measured = measured @ self.design.axes
        width = 2 * len(runs)
        allowed = np.full(stacked.shape[1] - width, priors.SLOPE_CHANGE_STD * self.span)
        most = priors.THERMOMETER_LAGS_S[-1][0]
        allowed[2:] = priors.thermometer_deviations(most, len(allowed) - 2)
        answer = np.empty((stacked.shape[1], 3))
        for axis in range(3):
            further = np.zeros((len(stacked), 0)) if beside is None else beside[:, axis]
            known = np.column_stack([stacked[:, :width], further])
            plain = np.linalg.lstsq(known, measured[:, axis], rcond=LEAST_NEW_LENGTH)[0]
            left = float((measured[:, axis] - known @ plain).std())
            typical = float(np.abs(plain[1:width:2]).mean()) / self.span
            free = np.full(width, np.inf)  # a line, also where its slope is zero
            bends = np.maximum(allowed * typical, 1e-300)
            ridge = np.concatenate([
                np.column_stack([stacked, further]),
                np.diag(left / np.concatenate([free, bends, np.ones(further.shape[1])])),
            ])  # fmt: skip
            size = np.maximum(np.abs(ridge).max(axis=0), 1e-300)
            target = np.append(measured[:, axis], np.zeros(ridge.shape[1]))
            found = np.linalg.lstsq(ridge / size, target, rcond=LEAST_NEW_LENGTH)[0] / size
            answer[:, axis] = found[: stacked.shape[1]]
        return answer


@dataclass(frozen=True, eq=False)
class TemperatureSlope:
    """Slope over temperature of each run along a design's axes: the derivative of its course."""

    low: float
    """Lowest temperature [°C] …"""
    span: float
    """… and the range above it [K]."""
    lines: Mapping[str, FloatArray]
    """(3,) slope of each run at the lowest temperature, by name [unit]."""
    square: FloatArray
    """(3,) over the range [unit]."""
    cube: FloatArray
    """(3,) over the range [unit]."""

    @classmethod
    def of(cls, design: CandidateDesign) -> TemperatureSlope:
        """Return the slopes of the runs of a design."""
        course, runs = TemperatureCourse.of(design), design.source.smoothed
        found = course.coefficients()
        width = 2 * len(runs)
        lines = {run.name: line for run, line in zip(runs, found[1:width:2], strict=True)}
        return cls(course.low, course.span, lines, found[width], found[width + 1])

    def at(self, run: PreparedRun) -> FloatArray:
        """Return the (m, 3) slope over a run [unit/K]."""
        x = ((run.temperature - self.low) / self.span)[:, None]
        slope = self.lines[run.name] + 2.0 * self.square * x + 3.0 * self.cube * x**2
        return np.asarray(slope / self.span)

    def response(self, run: PreparedRun, errors: FloatArray) -> FloatArray:
        """Return (m, 3, q) what errors (n, q) of the temperature [K] do to the block means."""
        return run.block_mean(errors)[:, None, :] * self.at(run)[:, :, None]


def temperature_history(run: PreparedRun) -> FloatArray:
    """(n, q) derivatives of the temperature and what it is ahead of slower nodes."""
    return _history_of([run])


@kept
def _history_of(runs: Sequence[PreparedRun]) -> FloatArray:
    (run,) = runs
    temperature, time = run.conditions.temperature, run.conditions.time
    rate = np.gradient(temperature, time)
    parts = [
        follow(time, temperature, seconds)[0] - temperature
        for seconds in priors.THERMOMETER_PARTS_S
    ]
    return np.stack([rate, np.gradient(rate, time), *parts], axis=1)
