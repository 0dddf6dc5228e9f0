# SPDX-License-Identifier: Apache-2.0
"""Slopes of a device from a short measurement, with its lot as prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.model.values import SensorModel, ThermalModel

from imu_workbench.fleet.sources import NO_TYPE
from imu_workbench.fleet.statistics.population import device_effects, populations, run_variance
from imu_workbench.fleet.statistics.screening import odd_devices, screen
from imu_workbench.fleet.statistics.vectors import Vectors, read_vectors
from imu_workbench.fleet.table import FleetTable

OUTSIDE_P_VALUE = 0.01
"""p-value below which a device is said to be outside its lot."""


@dataclass(frozen=True, eq=False)
class SlopePrior:
    """Distribution of the slopes of one sensor before the device is measured."""

    mean: FloatArray
    """(3,)"""
    covariance: FloatArray
    """(3, 3)"""
    run_variance: FloatArray
    """(3,) of a single run about the device's slopes, beyond the variance of its fit."""


@dataclass(frozen=True, eq=False)
class FleetPrior:
    """The priors of all sensors, and the name of the lot or type they are of."""

    name: str
    sensors: Mapping[str, SlopePrior]


def fleet_prior(folder: Path, lot: str | None, kind: str, device: str) -> FleetPrior:
    """Return the distribution of a lot, or of the lots of a type where `lot` is None.

    `device` itself is left out. Raises UserError where the fleet knows no such lot or type.
    """
    table = FleetTable(folder)
    every = [vectors for name in SENSORS if len(vectors := read_vectors(table, name))]
    found, known = {}, set()
    odd = {one.device for one in odd_devices([(v, screen(v)) for v in every])} | {device}
    for vectors in every:
        lots, types = populations(vectors, [name not in odd for name in vectors.device])
        known |= {(one.type, one.lot) for one in lots}
        of_runs = _run_variance(vectors, kind)
        for one in lots:
            if (one.type, one.lot) == (kind, lot):
                covariance = one.covariance + one.mean_covariance
                found[one.sensor] = SlopePrior(one.mean, covariance, of_runs)
        for shared in types:
            if lot is None and shared.type == kind:
                found[shared.sensor] = SlopePrior(shared.mean, shared.of_devices, of_runs)
    if not found:
        raise UserError(_unknown(folder, lot, kind, sorted(known)))
    of_type = '' if kind == NO_TYPE else f' of type {kind}'
    return FleetPrior(f'lot {lot}{of_type}' if lot else f'its lots{of_type}', found)


def _run_variance(vectors: Vectors, kind: str) -> FloatArray:
    own = vectors.of(vectors.type == kind)
    return run_variance(own) if len(own) else np.zeros(3)


def _unknown(folder: Path, lot: str | None, kind: str, known: Sequence[tuple[str, str]]) -> str:
    lots = ', '.join(
        f'--lot {name}' if of == NO_TYPE else f'--lot {name} --type {of}' for of, name in known
    )
    asked = f'--lot {lot}' if lot else 'without --lot, three lots'
    of_type = '' if kind == NO_TYPE else f' of type {kind}'
    return f'{folder}: {asked}{of_type}: not known there; it knows {lots or "no lot"}'


def with_prior(
    model: ThermalModel, runs: Sequence[PreparedRun], prior: FleetPrior
) -> tuple[ThermalModel, list[str]]:
    """Return the model of a line per axis with its slopes shrunk to the prior, and warnings.

    Posterior of a normal distribution (`population.device_effects`); the variance of the slopes is
    that of the fit plus that from run to run. A warning names a sensor that is outside its lot.
    """
    sensors, warnings = dict(model.sensors), []
    for sensor in SENSORS:
        if sensor in prior.sensors and sensor in model.sensors:
            part, given = model.sensors[sensor], prior.sensors[sensor]
            own = [run for run in runs if run.valid(sensor).any()]
            sensors[sensor], distance = _shrunk(sensor, part, own, given)
            if distance < OUTSIDE_P_VALUE:
                warnings.append(
                    f'the {sensor} is outside {prior.name} (p = {distance:.1e}): measure it by a '
                    'full campaign and fit it without --fleet'
                )
    notes = (*model.provenance.notes, f'slopes with {prior.name} of a fleet as prior')
    provenance = replace(model.provenance, notes=notes)
    return replace(model, sensors=sensors, provenance=provenance), warnings


def _shrunk(
    sensor: Sensor, part: SensorModel, runs: Sequence[PreparedRun], given: SlopePrior
) -> tuple[SensorModel, float]:
    """Return the sensor with shrunk slopes, and the p-value of its distance from the prior."""
    from scipy.stats import chi2

    slopes = part.coefficients[0]
    error = part.covariance + np.diag(given.run_variance) / len(runs)
    shrunk, covariance = device_effects(slopes, error[None], given.mean, given.covariance)
    off = slopes[0] - given.mean
    distance = float(off @ np.linalg.solve(given.covariance + error, off))
    moved = slopes - shrunk
    levels = dict(part.levels)
    for run in runs:
        if run.name in levels:
            rows = run.valid(sensor)
            columns = run.columns(part.effects[0], sensor)[rows]
            levels[run.name] = levels[run.name] + columns.mean(axis=0) @ moved
    scale = np.abs(shrunk[0]) / np.maximum(np.abs(slopes[0]), 1e-300)
    contributions = {name: value * scale for name, value in part.contributions.items()}
    changed = replace(
        part,
        coefficients=(shrunk,),
        covariance=covariance[0],
        levels=levels,
        contributions=contributions,
    )
    return changed, float(chi2.sf(distance, 3))
