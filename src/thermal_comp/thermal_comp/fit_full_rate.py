# SPDX-License-Identifier: Apache-2.0
"""Ordinary least squares on every sample, with the covariance that coloured noise really gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording

from thermal_comp.conditions import SENSORS, Sensor
from thermal_comp.effects.effect import Effect
from thermal_comp.fit import Effects, fit_prepared
from thermal_comp.fit_solution import NormalEquations, solve
from thermal_comp.gram import gram
from thermal_comp.model import SensorModel, ThermalModel
from thermal_comp.noise_process import mean_autocovariance, toeplitz_product
from thermal_comp.preparation import Truth, prepare, resting
from thermal_comp.prepared_run import PreparedRun
from thermal_comp.startup import cut_startup


def fit_full_rate(
    effects: Effects,
    recordings: Sequence[ImuRecording],
    *,
    pooled: bool = False,
    truth: Truth | None = None,
) -> ThermalModel:
    """Return the fit to single samples instead of block means.

    Noise, shape parameters and whatever shares coefficients between axes come from block means;
    per-axis coefficients then from all samples at once.
    """
    runs = prepare(recordings, truth=truth)
    model = fit_prepared(effects, runs, pooled=pooled)
    sensors = dict(model.sensors)
    for listed in {m.effects for m in model.sensors.values()}:
        same = [s for s in SENSORS if s in model.sensors and model.sensors[s].effects == listed]
        if listed and not any(_shared(effect, runs[0], same) for effect in listed):
            refitted = _refit(listed, same, model, runs, recordings, truth or resting)
            sensors.update(refitted)
    notes = (*model.provenance.notes, 'coefficients per axis are fitted to single samples')
    return replace(model, sensors=sensors, provenance=replace(model.provenance, notes=notes))


def _shared(effect: Effect, run: PreparedRun, sensors: list[Sensor]) -> bool:
    """Tell whether axes share the effect's coefficients or its columns look at the sensor."""
    few = run.conditions.rows(slice(0, 50))
    columns = [effect.columns(few.of(sensor))[0] for sensor in sensors]
    return columns[0].ndim == 3 or any(not np.array_equal(columns[0], c) for c in columns)


def _refit(
    effects: tuple[Effect, ...],
    sensors: list[Sensor],
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    recordings: Sequence[ImuRecording],
    truth: Truth,
) -> dict[str, SensorModel]:
    equations: NormalEquations | None = None
    for recording in recordings:
        settled = cut_startup(recording)
        conditions = truth(settled)
        offset = (settled.stamp[0] - recording.stamp[0]) * 1e-9
        conditions = replace(conditions, time=conditions.time + offset)
        measured = [getattr(settled, SENSOR_FIELDS[sensor]) for sensor in sensors]
        part = gram(effects, conditions, measured).equations()
        equations = part if equations is None else equations + part
    assert equations is not None  # noqa: S101 (fit_prepared has refused an empty list)
    estimate = solve(equations).estimate
    refitted: dict[str, SensorModel] = {}
    for k, sensor in enumerate(sensors):
        before = model.sensors[sensor]
        own = estimate[:, 3 * k : 3 * k + 3]
        widths = np.cumsum([c.shape[0] for c in before.coefficients])[:-1]
        refitted[sensor] = replace(
            before,
            coefficients=tuple(np.split(own, widths)),
            covariance=sandwich(effects, sensor, before, runs),
        )
    return refitted


def sandwich(
    effects: Sequence[Effect], sensor: Sensor, model: SensorModel, runs: Sequence[PreparedRun]
) -> FloatArray:
    """Return the covariance (3p, 3p) of ordinary least squares under the fitted noise.

    (XᵀX)⁻¹ Xᵀ S X (XᵀX)⁻¹ on block means, whose slow part is that of the samples.
    """
    assert model.noise is not None  # noqa: S101 (every fit has one)
    normal: FloatArray = np.zeros((0, 0))
    spread: list[FloatArray] = []
    for run in runs:
        columns = np.concatenate([run.columns(e, sensor) for e in effects], axis=1)
        columns = columns - columns.mean(axis=0)
        turned = []
        for axis in range(3):
            noise = mean_autocovariance(model.noise, axis, run.period, int(run.slot[-1]) + 1)
            turned.append(columns.T @ toeplitz_product(noise, run.slot, columns))
        normal = columns.T @ columns if not normal.size else normal + columns.T @ columns
        spread = turned if not spread else [a + b for a, b in zip(spread, turned, strict=True)]
    scale = np.sqrt(np.diag(normal))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True)
    inverse /= np.outer(scale, scale)
    p = len(normal)
    covariance = np.zeros((p, 3, p, 3))
    for axis in range(3):
        covariance[:, axis, :, axis] = inverse @ spread[axis] @ inverse
    full: FloatArray = covariance.reshape(3 * p, 3 * p)
    return full
