# SPDX-License-Identifier: Apache-2.0
"""The study of a simulated fleet compared with its truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from imu_workbench.fleet.statistics.vectors import SENSORS


def score_fleet(found: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
    """Return outliers found, false alarms, errors of the lots' means, prevalence."""
    devices: Mapping[str, Any] = truth['devices']
    outliers = {name for name, one in devices.items() if one['outlier']}
    odd = {one['device'] for one in found['odd']}
    ordinary = len(devices) - len(outliers)
    errors = [
        (np.array(one['mean']) - np.array(truth['lots'][one['lot']]['mean'])[_axes(one)])
        / np.sqrt(np.diag(truth['lots'][one['lot']]['covariance']))[_axes(one)]
        for one in found['populations']
        if one['lot'] in truth['lots']
    ]
    shares = []
    for lot, drawn in truth['lots'].items():
        own = [one for one in devices.values() if one['lot'] == lot]
        for effect in drawn['effects']:
            has = sum(_has(one, effect) for one in own) / max(1, len(own))
            named = [
                one['share']
                for one in found['prevalence']
                if one['named']
                and (one['lot'], one['sensor'], one['effect'])
                == (lot, effect['sensor'], effect['name'])
            ]
            shares.append(
                {
                    'lot': lot,
                    'effect': effect['name'],
                    'sensor': effect['sensor'],
                    'true': has,
                    'found': named[0] if named else 0.0,
                }
            )
    score: dict[str, Any] = {
        'outliers': len(outliers),
        'outliers_found': len(outliers & odd),
        'false_alarms': len(odd - outliers) / max(1, ordinary),
        'worst_mean_error': float(np.abs(errors).max()) if errors else float('nan'),
        'prevalence': shares,
    }
    hits = f'{score["outliers_found"]} of {len(outliers)} outliers'
    score['lines'] = [
        f'found {hits}, false alarms {100 * score["false_alarms"]:.1f} % of {ordinary}',
        f"lots' means off by at most {score['worst_mean_error']:.2f} σ of the lot",
        *(
            f'lot {one["lot"]}: {one["effect"]} in {one["sensor"]}: '
            f'true {100 * one["true"]:.0f} %, found {100 * one["found"]:.0f} %'
            for one in shares
        ),
    ]
    return score


def _axes(one: Mapping[str, Any]) -> slice:
    first = 3 * SENSORS.index(one['sensor'])
    return slice(first, first + 3)


def _has(device: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    return any(
        (own['name'], own['sensor']) == (effect['name'], effect['sensor'])
        for own in device['effects']
    )
