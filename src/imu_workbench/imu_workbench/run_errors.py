# SPDX-License-Identifier: Apache-2.0
"""Measured error, modelled error and residual of a run, on block means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from imu_recording.recording import PHASES, FloatArray, IntArray
from numpy.typing import NDArray
from thermal_comp.conditions import SENSORS
from thermal_comp.model import ThermalModel
from thermal_comp.prepared_run import PreparedRun


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
