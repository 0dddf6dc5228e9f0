# SPDX-License-Identifier: Apache-2.0
"""One run as fits and diagnosis see it: block means, conditions on a finer grid, gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import PER_RUN, Conditions, Sensor
from thermal_comp.data.gaps import decays_after_gaps
from thermal_comp.data.rounding import Rounding
from thermal_comp.data.smoothing import errors_between_bursts, smoothed_conditions

if TYPE_CHECKING:
    from thermal_comp.effects.effect import Effect


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """One run as fits and diagnosis see it: m block means, conditions on a finer grid.

    Effects are evaluated on the fine rows (history, squares) and then averaged over the blocks.
    """

    name: str
    device: str
    conditions: Conditions
    """Fine rows; temperature and every present channel are finite."""
    starts: IntArray
    """(m, 2) first fine row of each block and the first one after it."""
    slot: IntArray
    """(m,) place of each block on the uniform grid of `period`; a gap is a missing place."""
    period: float
    """[s]."""
    measured: Mapping[Sensor, FloatArray]
    """(m, 3) block means per sensor, NaN where a block has no valid sample."""
    fine_measured: Mapping[Sensor, FloatArray]
    """(n, 3) what was measured at the fine rows, per sensor; NaN where missing."""
    cv_group: IntArray
    """(m,) part of the run that is held out together, 1 …; 0 is never held out."""
    has_cycles: bool
    """Whether these parts are thermal cycles; else they are contiguous stretches of blocks."""
    origin: int = 0
    """Stamp at which its time is zero [ns]."""
    sampled: bool = False
    """Whether the fine rows are samples, whose stamps may jitter, and not means."""
    rounding: Mapping[Sensor, Rounding] = field(default_factory=dict)
    """How coarsely each sensor's samples were read."""
    hash: str = ''
    """SHA-256 of the columns it was prepared from."""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.slot)

    def block_mean(self, values: FloatArray) -> FloatArray:
        """Return the (m, …) means of (n, …) fine rows over the blocks."""
        edges = self.starts.ravel()
        rows = edges[1::2] - edges[::2]
        total = np.add.reduceat(values[: edges[-1]], edges[:-1], axis=0)[::2]
        mean: FloatArray = total / rows.reshape(-1, *[1] * (values.ndim - 1))
        return mean

    def valid(self, sensor: Sensor) -> NDArray[np.bool_]:
        """Return the (m,) blocks in which all axes of a sensor were measured."""
        finite: NDArray[np.bool_] = np.isfinite(self.measured[sensor]).all(axis=1)
        return finite

    def columns(self, effect: Effect, sensor: Sensor) -> FloatArray:
        """Return the effect's (m, p) or (m, 3, p) columns, averaged over the blocks."""
        return self.block_mean(effect.columns(self.conditions.of(sensor))[0])

    @cached_property
    def smoothed(self) -> PreparedRun:
        """The run without the noise of its thermometer, for fits to the whole of it.

        Columns of a noisy temperature pull their coefficients towards zero (regression dilution;
        Carroll et al., Measurement Error in Nonlinear Models, 2006, ch. 4: regression
        calibration), the more the slower the temperature moves.
        """
        conditions, row = smoothed_conditions(self.conditions)
        if len(conditions) == len(self.conditions):
            return replace(self, conditions=conditions)
        starts = np.stack([row[self.starts[:, 0]], row[self.starts[:, 1] - 1] + 1], axis=1)
        measured = {s: np.full((len(conditions), 3), np.nan) for s in self.fine_measured}
        for sensor, values in self.fine_measured.items():
            measured[sensor][row] = values
        return replace(self, conditions=conditions, starts=starts, fine_measured=measured)

    @cached_property
    def errors_between_bursts(self) -> FloatArray:
        """(n, e) what the temperature of the smoothed run's fine rows may be off by [K]."""
        return errors_between_bursts(self.conditions)

    @cached_property
    def time(self) -> FloatArray:
        """(m,) mean time of each block since the first sample of the run [s]."""
        return self.block_mean(self.conditions.time)

    @cached_property
    def temperature(self) -> FloatArray:
        """(m,) mean die temperature of each block [°C]."""
        return self.block_mean(self.conditions.temperature)

    @cached_property
    def after_gaps(self) -> FloatArray:
        """(m, q) decays after gaps, of lags whose temperature in the gap was not measured.

        Each ends with the held-out part it begins in: its tail beyond tells nothing of its size.
        """
        decays = self.block_mean(decays_after_gaps(self.conditions.time))
        parts = [decays * (self.cv_group == k)[:, None] for k in np.unique(self.cv_group)]
        columns = np.concatenate([np.zeros((len(self), 0)), *parts], axis=1)
        return columns[:, columns.any(axis=0)]

    @cached_property
    def level_columns(self) -> FloatArray:
        """(m, 1 + q) what every fit to the run has, whatever the effects: level, `after_gaps`."""
        return np.column_stack([np.ones(len(self)), self.after_gaps])

    @cached_property
    def vibration(self) -> FloatArray | None:
        """(m,) variance of the acceleration within each block, summed over the axes [(m/s²)²]."""
        vibration = self.conditions.vibration
        return None if vibration is None else self.block_mean(vibration).sum(axis=1)

    @cached_property
    def phase(self) -> IntArray:
        """(m,) index into PHASES in the middle of each block; −1 unknown."""
        return self._middle(self.conditions.phase, -1)

    @cached_property
    def cycle(self) -> IntArray:
        """(m,) thermal cycle in the middle of each block; 0 outside the cycles."""
        return self._middle(self.conditions.cycle, 0)

    @cached_property
    def block_conditions(self) -> Conditions:
        """Conditions as block means."""
        taken: dict[str, Any] = {
            item.name: self.block_mean(value)
            for item in fields(self.conditions)
            if isinstance(value := getattr(self.conditions, item.name), np.ndarray)
            and item.name not in (*PER_RUN, 'phase', 'cycle')
        }
        return replace(self.conditions, phase=self.phase, cycle=self.cycle, **taken)

    def _middle(self, values: IntArray | None, unknown: int) -> IntArray:
        if values is None:
            return np.full(len(self.slot), unknown, dtype=np.int64)
        middle: IntArray = values[(self.starts[:, 0] + self.starts[:, 1] - 1) // 2]
        return middle
