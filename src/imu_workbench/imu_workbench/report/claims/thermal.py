# SPDX-License-Identifier: Apache-2.0
"""Claims of sections IV and V: size, orientation, devices, linearity, distribution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown

from imu_workbench.report.claims.claim import FALSE_ALARM_SHARE, Claim, untestable
from imu_workbench.report.slopes import compare_devices, compare_orientations, mean_and_uncertainty

EXCURSION_K = 60.0
"""From the cold to the hot dwell of the paper [K]."""

Slopes = Mapping[str, Mapping[str, Mapping[str, FloatArray]]]
"""Slopes (cycles, 3) in SI units per kelvin, by device, sensor and orientation."""


def range_claim(ranges: Mapping[str, Mapping[str, Any]]) -> Claim:
    """Compare the largest range of any channel with the one the paper states."""
    said = (
        'Temperature makes outputs range over up to 0.31 °/s, 5.92 m/s² and 132.01 µT '
        '(section IV; printed as nT)'
    )
    if not ranges:
        return untestable('ranges', said, 'There are no samples.')
    ours, with_start_up = (
        ', '.join(f'{shown(found[kind])} {found["unit"]}' for found in ranges.values())
        for kind in ('without_start_up', 'with_start_up')
    )
    ratios = [found['without_start_up'] / found['paper'] for found in ranges.values()]
    alike = min(ratios) >= 0.5 and max(ratios) <= 2.0
    return Claim(
        key='ranges',
        claim=said,
        ours=f'{ours} without start-up samples, {with_start_up} with them',
        verdict='supported' if alike else 'not',
        why=(
            'Supported where every sensor’s largest range without start-up samples is within a '
            'factor of two. The paper’s own tables hold 0.48 °/s and 5.98 m/s², and its 5.92 m/s² '
            'is a start-up sample, not temperature: the largest range off the gravity axis is '
            '3.06 m/s².'
        ),
        numbers={'ranges': dict(ranges)},
    )


def orientation_claim(slopes: Slopes) -> Claim:
    """Test slope × orientation, per device, sensor and axis."""
    said = 'The temperature’s influence is not correlated with the orientation (section IV)'
    rows: list[dict[str, Any]] = []
    for device, sensors in slopes.items():
        for sensor, by_orientation in sensors.items():
            found = compare_orientations(by_orientation)
            if found is not None:
                rows.append(
                    {
                        'device': device,
                        'sensor': sensor,
                        'p_value': found.p_value,
                        'difference_over_60_k': (
                            found.difference * EXCURSION_K * DISPLAY_UNITS[sensor].factor
                        ),
                        'unit': DISPLAY_UNITS[sensor].unit,
                    }
                )
    if not rows:
        return untestable(
            'orientation',
            said,
            'One device was recorded in one orientation only, as in Tables III–V: device and '
            'orientation cannot be told apart.',
        )
    p_values = np.concatenate([row['p_value'] for row in rows])
    limit = FALSE_ALARM_SHARE / len(p_values)
    differing = int((p_values < limit).sum())
    worst = {
        sensor: max(
            float(np.max(row['difference_over_60_k'])) for row in rows if row['sensor'] == sensor
        )
        for sensor in SENSORS
        if any(row['sensor'] == sensor for row in rows)
    }
    sizes = ', '.join(f'{shown(v, 2)} {DISPLAY_UNITS[s].unit}' for s, v in worst.items())
    return Claim(
        key='orientation',
        claim=said,
        ours=(
            f'{differing} of {len(p_values)} channels have slopes that differ between '
            f'orientations; the largest difference over 60 K is {sizes}'
        ),
        verdict='not' if differing else 'supported',
        why='Analysis of variance of the cycles’ slopes between orientations, '
        f'{FALSE_ALARM_SHARE:.0%} over all channels together. Cycles of one run share its '
        'mounting, so that a difference between runs counts as one between orientations; a scale '
        'factor that depends on temperature shows up here on the axis that feels gravity.',
        numbers={'tests': rows},
    )


def device_claim(slopes: Slopes) -> Claim:
    """Compare slopes between devices by their normalised difference."""
    said = 'Each device has its own relation to temperature: slopes not compatible (section IV)'
    rows: list[dict[str, Any]] = []
    for sensor in SENSORS:
        by_device = {
            device: np.concatenate(list(sensors[sensor].values()))
            for device, sensors in slopes.items()
            if sensors.get(sensor)
        }
        rows += [
            {
                'sensor': sensor,
                'devices': pair.devices,
                'normalised_difference': pair.normalised_difference,
                'opposite': pair.opposite,
            }
            for pair in compare_devices(by_device)
        ]
    if not rows:
        return untestable('devices', said, 'There are recordings of one device only.')
    values = np.concatenate([row['normalised_difference'] for row in rows])
    opposite = int(sum(row['opposite'].sum() for row in rows))
    apart = int((values > 1.0).sum())
    return Claim(
        key='devices',
        claim=said,
        ours=f'{apart} of {len(values)} pairs of slopes are not compatible (normalised difference '
        f'up to {shown(float(values.max()))}); {opposite} pairs have opposite signs',
        verdict='supported' if apart else 'not',
        why=(
            'Normalised difference |b₁ − b₂| / √(U₁² + U₂²) above 1, U twice the standard '
            'deviation of the mean of the cycles’ slopes.'
        ),
        numbers={'pairs': rows},
    )


def overheating_claim(overheating: Mapping[str, Mapping[str, Any]]) -> Claim:
    """Say how much warmer than the air the devices are."""
    said = 'Thermocouples on the devices show their overheating above the air (section III)'
    if not overheating:
        return untestable('overheating', said, 'Chamber air or its phases were not logged.')
    parts = []
    for label in ('thermocouple', 'die'):
        means = [found[label]['mean_k'] for found in overheating.values() if label in found]
        if means:
            parts.append(f'{label} {shown(min(means), 2)} … {shown(max(means), 2)} K above air')
    return Claim(
        key='overheating',
        claim=said,
        ours='; '.join(parts),
        verdict='supported',
        why='Mean over the dwells. The paper gives no number.',
        numbers={'runs': dict(overheating)},
    )


def slope_table(slopes: Slopes) -> list[dict[str, Any]]:
    """Return mean slope and standard uncertainty per device, sensor and axis, display units."""
    rows: list[dict[str, Any]] = []
    for device, sensors in slopes.items():
        for sensor, by_orientation in sensors.items():
            if not by_orientation:
                continue
            mean, uncertainty = mean_and_uncertainty(np.concatenate(list(by_orientation.values())))
            factor = DISPLAY_UNITS[sensor].factor
            rows.append(
                {
                    'device': device,
                    'sensor': sensor,
                    'unit': f'{DISPLAY_UNITS[sensor].unit}/K',
                    'slope': mean * factor,
                    'uncertainty': uncertainty * factor,
                    'cycles': sum(len(values) for values in by_orientation.values()),
                }
            )
    return rows


def pooled_claim(tests: Mapping[str, Mapping[str, Any]]) -> Claim:
    """Compare the residual of one model for all devices with that of one model for each."""
    said = 'One model for all devices fails, because slopes have opposite signs (section V)'
    if not tests:
        return untestable('pooled', said, 'There are recordings of one device only.')
    factors = {
        sensor: np.asarray(test['pooled_rms']) / np.asarray(test['own_rms'])
        for sensor, test in tests.items()
    }
    worst = max(float(np.nanmax(factor)) for factor in factors.values())
    opposite = sum(sum(test['opposite_signs']) for test in tests.values())
    grown = ', '.join(f'{s} × {shown(float(np.nanmax(f)), 2)}' for s, f in factors.items())
    return Claim(
        key='pooled',
        claim=said,
        ours=(
            f'the pooled residual is larger than the individual one: {grown} on the worst axis of '
            f'the worst device; {opposite} of {3 * len(tests)} axes have slopes of opposite sign'
        ),
        verdict='supported' if worst > 1.5 and opposite else 'not',
        why=(
            'Rms of block means after the pooled and after the individual model; supported where '
            'it grows by half or more and opposite signs are the reason.'
        ),
    )
