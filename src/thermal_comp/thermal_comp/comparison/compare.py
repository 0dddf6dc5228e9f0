# SPDX-License-Identifier: Apache-2.0
"""Measured against modelled error: its size, its noise floor, and where it is largest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray, ImuRecording
from numpy.typing import ArrayLike

from thermal_comp.comparison.gaussianity import DwellModes, Gaussianity, dwell_modes, gaussianity
from thermal_comp.comparison.held_out import HeldOut, hold_out
from thermal_comp.comparison.localisation import Where, rank_where
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import Truth, prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.inputs import device_of, sensor_groups, usable_sensors
from thermal_comp.linear.design import Design
from thermal_comp.linear.normal_equations import solve
from thermal_comp.model.file import check_device
from thermal_comp.model.values import ModelError, NoiseModel, ThermalModel
from thermal_comp.noise.of_model import noise_of_model
from thermal_comp.noise.of_runs import noise_of_runs
from thermal_comp.presentation.notebook import Presented

SCHEMA = 1
"""Version of the dictionary of a comparison."""


@dataclass(frozen=True, eq=False)
class SensorComparison:
    """One sensor; all errors are rms of block means per axis, (3,) in its SI unit."""

    unit: str
    measured_rms: FloatArray
    """Before compensation, about the mean of each run."""
    residual_rms: FloatArray
    """Measured minus model, about the mean of each run."""
    held_out_rms: FloatArray
    """On parts the fit of the same effects has not seen, about the level of the rest."""
    held_out_squares: FloatArray
    """(k, 3) mean squares of the held-out error in each part of each run [unit²]."""
    noise_floor: FloatArray
    """The `held_out_rms` to expect of the noise alone that was fitted beside the model."""
    r_squared: FloatArray
    """Share of the measured variance the model explains."""
    where: tuple[Where, ...]
    """Groups of blocks, worst first."""
    gaussianity_before: tuple[Gaussianity, ...]
    """Per axis."""
    gaussianity_after: tuple[Gaussianity, ...]
    modes_before: DwellModes | None
    modes_after: DwellModes | None
    residuals: tuple[FloatArray, ...]
    """(m, 3) measured minus model about its mean, block by block, of each run."""

    @property
    def worst_phase(self) -> str | None:
        """Phase with the largest residual; None without phases."""
        phases = (w.group['phase'] for w in self.where if set(w.group) == {'phase'})
        return next(phases, None)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'unit': self.unit,
            'measured_rms': self.measured_rms,
            'residual_rms': self.residual_rms,
            'held_out_rms': self.held_out_rms,
            'noise_floor': self.noise_floor,
            'r_squared': self.r_squared,
            'worst_phase': self.worst_phase,
            'where': [where.to_dict() for where in self.where],
            'gaussianity': {
                'before': [vars(test) for test in self.gaussianity_before],
                'after': [vars(test) for test in self.gaussianity_after],
                'modes_before': self.modes_before and vars(self.modes_before),
                'modes_after': self.modes_after and vars(self.modes_after),
            },
        }


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Presented):
    """A model against recordings."""

    presentation = 'comparison'

    device: str
    sensors: Mapping[Sensor, SensorComparison]
    period: float
    """Length of the blocks all errors are quoted on [s]."""
    held_out: str
    """What was held out at a time, in words."""
    times: tuple[FloatArray, ...]
    """(m,) time of each block since the first sample of its run [s], of each run."""
    notes: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, schema 1."""
        return {
            'schema': SCHEMA,
            'device': self.device,
            'period': self.period,
            'held_out': self.held_out,
            'sensors': {name: sensor.to_dict() for name, sensor in self.sensors.items()},
            'notes': list(self.notes),
        }


def compare(
    model: ThermalModel,
    recordings: Sequence[ImuRecording],
    *,
    truth: Truth | None = None,
    period: float | None = None,
) -> Comparison:
    """Return where and how much the recordings differ from the model.

    Levels and campaign effects are taken from the recordings, device effects from the model; the
    held-out error is that of the same effects fitted to the rest of the recordings.
    """
    return compare_prepared(model, prepare(recordings, truth=truth, period=period))


def compare_prepared(
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    *,
    noise: Mapping[Sensor, NoiseModel] | None = None,
) -> Comparison:
    """Return the comparison with prepared runs; `noise` saves estimating it again."""
    device = device_of(runs, pooled=model.pooled)
    for run in runs:
        check_device(model, run.device)
    sensors, left_out = _compared_sensors(model, runs)
    listed, not_applied = _applicable_effects(model, runs, sensors)
    seen = {run.hash for run in runs} <= set(model.provenance.sources.values())
    weights = {s: (noise or {}).get(s) or _noise(model, s, runs, seen=seen) for s in sensors}
    weights = {s: _weighed_as(model, s, weights[s]) for s in sensors}
    weights = {s: noise_of_model(runs, s, listed[s], weights[s]) for s in sensors}
    compared: dict[Sensor, SensorComparison] = {}
    relearned: list[str] = []
    for group in sensor_groups(listed):
        effects = {s: listed[s] for s in group}
        held = hold_out(runs, effects, weights)
        residuals = _residuals(model, runs, effects, weights)
        compared |= {s: _compare_sensor(runs, s, residuals[s], held) for s in group}
        if held.relearned:
            relearned.append(
                f'{"+".join(group)}: {", ".join(held.relearned)} of a held-out part is '
                'known from that part alone and was taken from it, like a level'
            )
    unseen = (
        'the model has not seen these recordings: its residual is itself held out; '
        'diagnose BAG… --model MODEL says whether its coefficients still hold'
    )
    own = [note for run in runs for note in run.notes]
    cycles = all(run.has_cycles for run in runs)
    return Comparison(
        device=model.device or device,
        sensors={s: compared[s] for s in sensors},
        period=runs[0].period,
        held_out='one thermal cycle at a time' if cycles else 'one contiguous block at a time',
        times=tuple(run.time for run in runs),
        notes=(*own, *left_out, *([] if seen else [unseen]), *not_applied, *relearned),
    )


def _compared_sensors(
    model: ThermalModel, runs: Sequence[PreparedRun]
) -> tuple[list[Sensor], list[str]]:
    """Return the sensors that runs and model have, and why others are left out."""
    measured, left_out = usable_sensors(runs)
    sensors = [s for s in measured if s in model.sensors]
    if not sensors:
        raise ModelError(
            f'sensors: the model has {", ".join(model.sensors)}, the recordings have '
            f'{", ".join(measured)}'
        )
    return sensors, left_out


def _applicable_effects(
    model: ThermalModel, runs: Sequence[PreparedRun], sensors: Sequence[Sensor]
) -> tuple[dict[Sensor, tuple[Effect, ...]], list[str]]:
    """Return the model's effects whose channels all runs have logged, and notes on the others."""
    listed: dict[Sensor, tuple[Effect, ...]] = {}
    notes = []
    for sensor in sensors:
        present = []
        for effect in model.sensors[sensor].effects:
            missing = [c for c in effect.needs if not all(r.conditions.has(c) for r in runs)]
            if missing:
                notes.append(f'{sensor}: {effect.name} not applied, {missing[0]} is not logged')
            else:
                present.append(effect)
        listed[sensor] = tuple(present)
    return listed, notes


def _noise(
    model: ThermalModel, sensor: Sensor, runs: Sequence[PreparedRun], *, seen: bool
) -> NoiseModel:
    """Return the model's noise where it has seen the runs, else that of the runs."""
    part = model.sensors[sensor]
    if seen and part.noise is not None:
        return part.noise
    return noise_of_runs(runs, sensor, part.effects)[0]


def _weighed_as(model: ThermalModel, sensor: Sensor, noise: NoiseModel) -> NoiseModel:
    """Return the noise with the weights that the model was fitted with."""
    fitted = model.sensors[sensor].noise
    return noise if fitted is None else replace(noise, white_weights=fitted.white_weights)


def _residuals(
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    listed: Mapping[Sensor, tuple[Effect, ...]],
    noise: Mapping[Sensor, NoiseModel],
) -> dict[Sensor, list[FloatArray]]:
    """Return measured − device effects − campaign effects and levels refitted, per run (m, 3)."""
    campaign = {s: tuple(e for e in listed[s] if e.kind == 'campaign') for s in listed}
    design = Design(runs, campaign, noise)
    left: dict[tuple[int, Sensor], FloatArray] = {}
    for sensor in listed:
        part = model.sensors[sensor]
        for r, run in enumerate(runs):
            error = np.zeros((len(run), 3))
            for _, effect, coefficients in part.device_terms():
                if effect in listed[sensor]:
                    error += run.columns(effect, sensor) @ coefficients
            left[r, sensor] = (run.measured[sensor] - error)[:, :, None]
    estimate = solve(design.weighted.equations(left)).estimate[:, 0]
    return {
        sensor: [
            _about_mean(
                left[r, sensor][:, :, 0]
                - design.predicted(estimate, r, sensor)
                - design.offsets(estimate, r, sensor)
            )
            for r in range(len(runs))
        ]
        for sensor in listed
    }


def _about_mean(values: FloatArray) -> FloatArray:
    centred: FloatArray = values - np.nanmean(values, axis=0)
    return centred


def _compare_sensor(
    runs: Sequence[PreparedRun], sensor: Sensor, residuals: list[FloatArray], held: HeldOut
) -> SensorComparison:
    before = [_about_mean(run.measured[sensor]) for run in runs]
    measured, residual = np.concatenate(before), np.concatenate(residuals)
    phase = np.concatenate([run.phase for run in runs])
    total = np.nansum(measured**2, axis=0)
    floor = held.floor(sensor)
    return SensorComparison(
        unit=SENSOR_UNITS[sensor],
        measured_rms=np.sqrt(np.nanmean(measured**2, axis=0)),
        residual_rms=np.sqrt(np.nanmean(residual**2, axis=0)),
        held_out_rms=held.rms(sensor),
        held_out_squares=part_squares(held, sensor),
        noise_floor=floor,
        r_squared=1.0 - np.nansum(residual**2, axis=0) / total,
        where=rank_where(runs, residuals, floor),
        gaussianity_before=_tests(before),
        gaussianity_after=_tests(residuals),
        modes_before=dwell_modes(measured, phase),
        modes_after=dwell_modes(residual, phase),
        residuals=tuple(residuals),
    )


def rms_of(per_axis: ArrayLike) -> float:
    """Return the rms over the axes that have a value; NaN where none has."""
    values = np.asarray(per_axis, dtype=np.float64)
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float('nan')


def part_squares(held: HeldOut, sensor: Sensor) -> FloatArray:
    """Return the (k, 3) mean square of the held-out error in each part of each run."""
    found: list[FloatArray] = []
    for (run, s), errors in held.errors.items():
        if s == sensor:
            part = np.where(np.isfinite(errors).all(axis=1), held.parts[run], 0)
            found += [(errors[part == p] ** 2).mean(axis=0) for p in np.unique(part[part > 0])]
    return np.array(found).reshape(-1, 3)


def _tests(runs: Sequence[FloatArray]) -> tuple[Gaussianity, ...]:
    clean = [run[np.isfinite(run).all(axis=1)] for run in runs]
    return tuple(gaussianity([run[:, axis] for run in clean]) for axis in range(3))
