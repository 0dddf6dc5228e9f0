# SPDX-License-Identifier: Apache-2.0
"""The results of a fleet as one dictionary: page, JSON and terminal show the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.user_error import UserError
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect

from imu_workbench.fleet.estimate import version
from imu_workbench.fleet.shortening import curve_content, shortening_curve
from imu_workbench.fleet.statistics.clusters import find_clusters
from imu_workbench.fleet.statistics.population import (
    LEAST_DEVICES,
    Population,
    TypePopulation,
    error_variances,
    populations,
)
from imu_workbench.fleet.statistics.prevalence import prevalences
from imu_workbench.fleet.statistics.process_control import capabilities, control_chart
from imu_workbench.fleet.statistics.screening import Screening, odd_devices, screen
from imu_workbench.fleet.statistics.shape_population import shape_populations
from imu_workbench.fleet.statistics.vectors import SENSORS, Vectors, read_vectors
from imu_workbench.fleet.table import FleetTable
from imu_workbench.report.limits import CoefficientLimits

SCHEMA = 1


def study(
    folder: Path,
    limits: CoefficientLimits | None = None,
    catalogue: Mapping[str, type[Effect]] = EFFECTS,
) -> dict[str, Any]:
    """Return populations, odd devices, clusters, prevalence, control charts and failures.

    With `limits`: the capability of each lot to keep them. `catalogue` holds the effects that the
    devices were tried for.
    """
    table = FleetTable(folder)
    sensors = [vectors for name in SENSORS if len(vectors := read_vectors(table, name))]
    screened = [(vectors, screen(vectors)) for vectors in sensors]
    odd = odd_devices(screened)
    names = {one.device for one in odd}
    ordinary = [populations(v, [d not in names for d in v.device]) for v in sensors]
    lots = [one for found, _ in ordinary for one in found]
    types = [one for _, found in ordinary for one in found]
    curve = shortening_curve(table, sensors, sorted(names))
    described = [_population(one, sensors) for one in lots]
    left_out = {(one.device, one.sensor) for one in odd}
    effects = prevalences(table, left_out)
    shapes = shape_populations(table, [one for one in effects if one.named], catalogue, left_out)
    return {
        'schema': SCHEMA,
        'devices': int(table.rows('SELECT count(DISTINCT source) FROM results')[0][0]),
        'estimated': max((len(vectors) for vectors in sensors), default=0),
        'failed': dict(
            table.rows("SELECT device, reason FROM results WHERE role = 'failed' ORDER BY device")
        ),
        'without_lot': int(
            table.rows("SELECT count(DISTINCT source) FROM results WHERE lot = 'none'")[0][0]
        ),
        'other_version': int(
            table.rows(
                """SELECT count(DISTINCT source) FROM results WHERE role = 'fitted'
                   AND (version IS DISTINCT FROM $version OR block_share IS NULL)""",
                version=version(),
            )[0][0]
        ),
        'populations': described,
        'types': [_type(one) for one in types],
        'capability': [
            {**asdict(one), 'capable': one.capable}
            for one in (capabilities(described, limits) if limits else ())
        ],
        'odd': [asdict(one) for one in odd],
        'clusters': _clusters(sensors, names),
        'prevalence': [
            {**asdict(one), 'named': one.named}
            for one in effects
            if one.named or one.probability > 0.05
        ],
        'shapes': [one.content() for one in shapes],
        'shortening': curve and curve_content(curve),
        'control': [entry for vectors in sensors for entry in _control(vectors)],
        'scores': _scores(screened),
    }


def fleet_curve(folder: Path) -> dict[str, Any]:
    """Return the shortening curve alone; UserError where no lot is large enough for one."""
    table = FleetTable(folder)
    sensors = [vectors for name in SENSORS if len(vectors := read_vectors(table, name))]
    odd = odd_devices([(vectors, screen(vectors)) for vectors in sensors])
    curve = shortening_curve(table, sensors, [one.device for one in odd])
    if curve is None:
        raise UserError(
            f'{folder}: no lot of {2 * LEAST_DEVICES - 1} devices with two runs or more each, '
            'of which one half is the prior of the other; give `fleet` more devices'
        )
    return curve_content(curve)


def _population(one: Population, sensors: list[Vectors]) -> dict[str, Any]:
    vectors = next(v for v in sensors if v.sensor == one.sensor)
    group = vectors.of((vectors.type == one.type) & (vectors.lot == one.lot))
    return {
        **_distribution(one),
        'lot': one.lot,
        'devices': one.devices,
        'run_std': one.run_std.tolist(),
        'estimate_std': np.sqrt(np.median(error_variances(group), axis=0)).tolist(),
    }


def _type(one: TypePopulation) -> dict[str, Any]:
    return {
        **_distribution(one),
        'lots': one.lots,
        'within': one.within.tolist(),
        'within_std': np.sqrt(np.diag(one.within)).tolist(),
    }


def _distribution(one: Population | TypePopulation) -> dict[str, Any]:
    return {
        'type': one.type,
        'sensor': one.sensor,
        'unit': one.unit,
        'mean': one.mean.tolist(),
        'mean_std': np.sqrt(np.diag(one.mean_covariance)).tolist(),
        'covariance': one.covariance.tolist(),
        'std': np.sqrt(np.diag(one.covariance)).tolist(),
    }


def _clusters(sensors: list[Vectors], odd: set[str]) -> list[dict[str, Any]]:
    """Return the clusters of each type, over the devices that have every sensor."""
    if not sensors:
        return []
    common = set.intersection(*(set(v.device.tolist()) for v in sensors))
    whole = [v.of(np.isin(v.device, sorted(common))) for v in sensors]
    found = []
    for kind in np.unique(whole[0].type):
        own = [v.of(v.type == kind) for v in whole]
        clusters = find_clusters(own, [d not in odd for d in own[0].device])
        found.append({'type': str(kind), 'count': clusters.count, 'lots': clusters.table})
    return found


def _control(vectors: Vectors) -> list[dict[str, Any]]:
    """Return a chart per type, lot and axis, devices in the order they were measured."""
    found = []
    for (kind, lot), group in vectors.groups():
        if len(group) < 2:
            continue
        order = np.lexsort((group.device, group.measured_at))
        for a, axis in enumerate('xyz'):
            chart = control_chart(group.coefficients[order, a])
            found.append(
                {
                    'type': kind,
                    'lot': lot,
                    'sensor': vectors.sensor,
                    'axis': axis,
                    'unit': vectors.unit,
                    'centre': chart.centre,
                    'sigma': chart.sigma,
                    'limits': list(chart.limits),
                    'beyond': [str(group.device[order[i]]) for i in chart.beyond],
                    'drift_at': [str(group.device[order[i]]) for i in chart.on_one_side],
                }
            )
    return found


def _scores(screened: list[tuple[Vectors, Screening]]) -> dict[str, dict[str, float]]:
    """Return, by device and sensor, −log10 of the smaller p-value: the map of the page."""
    found: dict[str, dict[str, float]] = {}
    for vectors, screening in screened:
        p = np.fmin(screening.coefficients, screening.misfit)
        score = -np.log10(np.maximum(p, 1e-300))
        for device, value in zip(vectors.device, score, strict=True):
            if np.isfinite(value):
                found.setdefault(str(device), {})[vectors.sensor] = float(value)
    return found
