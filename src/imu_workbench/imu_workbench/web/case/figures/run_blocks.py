# SPDX-License-Identifier: Apache-2.0
"""Block means of one run, measured and modelled, per sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray
from thermal_comp.comparison.localisation import orientation
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.inputs import sensor_groups
from thermal_comp.linear.design import Design
from thermal_comp.linear.normal_equations import solve
from thermal_comp.model.values import ThermalModel
from thermal_comp.noise.of_runs import noise_of_runs


@dataclass(frozen=True, eq=False)
class RunBlocks:
    """Block means of one run."""

    run: str
    orientation: str
    """Axis that points up, '+x' … '-z'."""
    period: float
    """[s]."""
    time: FloatArray
    """(m,) since the first sample of the recording [s]."""
    temperature: FloatArray
    """(m,) die [°C]."""
    rate: FloatArray
    """(m,) of the die temperature [°C/min]."""
    phase: IntArray
    """(m,) index into PHASES; −1 unknown."""
    cycle: IntArray
    """(m,)"""
    level: Mapping[str, FloatArray]
    """(3,) per sensor: output without modelled error [SI unit]."""
    measured: Mapping[str, FloatArray]
    """(m, 3) per sensor: above the level [SI unit]."""
    modelled: Mapping[str, FloatArray]
    """(m, 3) per sensor: device and campaign effects [SI unit]."""

    def residual(self, sensor: str) -> FloatArray:
        """(m, 3) measured minus modelled [SI unit]."""
        difference: FloatArray = self.measured[sensor] - self.modelled[sensor]
        return difference

    def at(self, rows: NDArray[np.bool_]) -> RunBlocks:
        """Return some of the blocks; `rows` (m,) tells which."""
        per_block = ('time', 'temperature', 'rate', 'phase', 'cycle')
        own = {name: getattr(self, name)[rows] for name in per_block}
        measured = {s: values[rows] for s, values in self.measured.items()}
        modelled = {s: values[rows] for s, values in self.modelled.items()}
        return replace(self, measured=measured, modelled=modelled, **own)


def blocks_of_runs(model: ThermalModel, runs: Sequence[PreparedRun]) -> list[RunBlocks]:
    """Return the blocks of every run.

    Device effects come from the model; campaign effects and levels are fitted to these runs, as
    the comparison does.
    """
    modelled: dict[tuple[int, str], FloatArray] = {}
    for group in _grouped(model, runs):
        modelled |= _modelled(model, runs, group)
    found = []
    for r, run in enumerate(runs):
        sensors = [s for s in SENSORS if (r, s) in modelled]
        level: dict[str, FloatArray] = {
            s: np.nanmean(run.measured[s] - modelled[r, s], axis=0) for s in sensors
        }
        found.append(
            RunBlocks(
                run=run.name,
                orientation=orientation(run),
                period=run.period,
                time=run.time,
                temperature=run.temperature,
                rate=_rate(run),
                phase=run.phase,
                cycle=run.cycle,
                level=level,
                measured={s: run.measured[s] - level[s] for s in sensors},
                modelled={s: modelled[r, s] for s in sensors},
            )
        )
    return found


def _rate(run: PreparedRun) -> FloatArray:
    if len(run) < 2:
        return np.zeros(len(run))
    rate: FloatArray = np.gradient(run.temperature, run.time) * 60.0
    return rate


def _grouped(model: ThermalModel, runs: Sequence[PreparedRun]) -> list[dict[Sensor, list[Effect]]]:
    known: dict[Sensor, tuple[Effect, ...]] = {
        s: tuple(
            e
            for e in model.sensors[s].effects
            if all(r.conditions.has(c) for r in runs for c in e.needs)
        )
        for s in SENSORS
        if s in model.sensors and all(np.isfinite(run.measured[s]).any() for run in runs)
    }
    return [{s: list(known[s]) for s in group} for group in sensor_groups(known)]


def _modelled(
    model: ThermalModel, runs: Sequence[PreparedRun], sensors: Mapping[Sensor, list[Effect]]
) -> dict[tuple[int, str], FloatArray]:
    device: dict[tuple[int, Sensor], FloatArray] = {}
    for sensor, effects in sensors.items():
        for r, run in enumerate(runs):
            error = np.zeros((len(run), 3))
            for _, effect, coefficients in model.sensors[sensor].device_terms():
                if effect in effects:
                    error += run.columns(effect, sensor) @ coefficients
            device[r, sensor] = error
    campaign = {s: tuple(e for e in e_all if e.kind == 'campaign') for s, e_all in sensors.items()}
    if not any(campaign.values()):
        return {(r, s): error for (r, s), error in device.items()}
    noise = {s: model.sensors[s].noise or noise_of_runs(runs, s)[0] for s in sensors}
    design = Design(runs, campaign, noise)
    left = {(r, s): (runs[r].measured[s] - e)[:, :, None] for (r, s), e in device.items()}
    estimate = solve(design.equations(left)).estimate
    return {
        (r, s): error + design.predicted(estimate, r, s)[:, :, 0]
        for (r, s), error in device.items()
    }
