# SPDX-License-Identifier: Apache-2.0
"""Claims of section V: a line is enough, one model for all is not, what is left is Gaussian."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from thermal_comp.presentation.display import SENSORS, shown

from imu_workbench.report.analysis import Analysis
from imu_workbench.report.claims.claim import FALSE_ALARM_SHARE, Claim, untestable
from imu_workbench.report.modelled import RunErrors, binned

LARGEST_DEVIATION_SHARE = 0.1
"""Deviation from the line, as a part of its span, up to which it counts as linear."""


def linearity_claim(analysis: Analysis) -> Claim:
    """Compare what the mean error deviates from the model with the model's span."""
    said = 'The dependence is linear, so that a line per axis is enough (section V, Fig. 5)'
    rows: list[dict[str, Any]] = []
    for device in analysis.devices:
        runs = [run.errors for run in analysis.runs if run.errors and run.device == device.name]
        for sensor in SENSORS:
            found = _linearity([run for run in runs if sensor in run.measured], sensor)
            if found:
                rows.append({'device': device.name, 'sensor': sensor, **found})
    if not rows:
        return untestable('linear', said, 'There is no model of these recordings.')
    squared = np.concatenate([row['r_squared'] for row in rows])
    deviation = np.concatenate([row['deviation'] for row in rows])
    clear = np.concatenate([row['clear'] for row in rows])
    bent = int((deviation[clear] > LARGEST_DEVIATION_SHARE).sum())
    missing = [
        f'{" or ".join([f["name"], *f["ambiguous_with"]])} of the {f["sensor"]} is missing'
        for found in analysis.diagnoses.values()
        for f in found['findings']
        if f['kind'] == 'effect'
    ]
    ours = 'no channel depends on temperature beyond its noise'
    if clear.any():
        lowest, highest = shown(float(squared.min())), shown(float(squared.max()), 4)
        largest = shown(100 * float(deviation[clear].max()), 2)
        ours = (
            f'R² {lowest} … {highest} on block means; bin means deviate from the model by up to '
            f'{largest} % of its span; {bent} of {int(clear.sum())} channels by more than 10 %'
        )
        ours += ''.join(f'; {text.replace("_", " ")}' for text in missing)
    return Claim(
        key='linear',
        claim=said,
        ours=ours,
        verdict='supported' if not bent and not missing else 'not',
        why=(
            'Largest mean residual in a bin of 2 K as a part of the model’s span, for channels '
            'whose span is above three times the residual’s standard deviation; not enough where '
            'the diagnosis names an effect beyond the line.'
        ),
        numbers={'channels': rows},
    )


def gaussianity_claim(analysis: Analysis) -> Claim:
    """Count channels whose distribution is Gaussian before and after, and their modes."""
    said = (
        'Raw distributions have two modes, at the cold and the hot dwell; compensated ones are '
        'Gaussian (section V, Fig. 6, χ² test)'
    )
    rows: list[dict[str, Any]] = []
    for device in analysis.devices:
        sensors = device.comparison.sensors.items() if device.comparison else ()
        for sensor, part in sensors:
            modes = part.modes_before
            rows += [
                {
                    'device': device.name,
                    'sensor': sensor,
                    'axis': axis,
                    'p_before': part.gaussianity_before[i].p_value,
                    'p_after': part.gaussianity_after[i].p_value,
                    'effective_n': part.gaussianity_after[i].effective_n,
                    'dwells_apart': float(modes.separation[i]) if modes else None,
                }
                for i, axis in enumerate('xyz')
            ]
    tested = [row for row in rows if np.isfinite(row['p_before'] + row['p_after'])]
    if not tested:
        return untestable(
            'gaussian',
            said,
            'There is no model of these recordings, or they hold too few independent samples.',
        )
    before = int(rejected([row['p_before'] for row in tested]).sum())
    after = int(rejected([row['p_after'] for row in tested]).sum())
    apart = [row['dwells_apart'] for row in tested if row['dwells_apart'] is not None]
    bimodal = sum(value > 2.0 for value in apart)
    return Claim(
        key='gaussian',
        claim=said,
        ours=(
            f'{before} of {len(tested)} channels are not Gaussian before compensation, {bimodal} '
            f'have two modes at the dwells; {after} are not Gaussian after it'
        ),
        verdict='supported' if not after and before > len(tested) / 2 and bimodal else 'not',
        why=(
            'χ² test of block means, thinned until they are independent, at '
            f'{FALSE_ALARM_SHARE:.0%} over all channels together (Holm); two modes where the '
            'dwells’ means are more than two standard deviations apart. Supported where most are '
            'rejected before and none after.'
        ),
        numbers={'channels': rows},
    )


def rejected(p_values: Sequence[float]) -> NDArray[np.bool_]:
    """Return which hypotheses Holm's procedure rejects at FALSE_ALARM_SHARE.

    >>> rejected([0.5, 1e-6, 0.004]).tolist()
    [False, True, True]
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p)
    passed = p[order] <= FALSE_ALARM_SHARE / np.arange(len(p), 0, -1)
    kept = np.logical_and.accumulate(passed)
    result = np.zeros(len(p), dtype=bool)
    result[order[kept]] = True
    return result


def _linearity(runs: Sequence[RunErrors], sensor: str) -> dict[str, Any] | None:
    if not runs:
        return None
    temperature = np.concatenate([run.temperature for run in runs])
    measured = np.concatenate([run.measured[sensor] for run in runs])
    modelled = np.concatenate([run.modelled[sensor] for run in runs])
    residual = measured - modelled
    _, means, _ = binned(temperature, residual)
    span = np.ptp(modelled[np.isfinite(modelled).all(axis=1)], axis=0)
    if not len(means):
        return None
    return {
        'r_squared': 1.0 - np.nanvar(residual, axis=0) / np.nanvar(measured, axis=0),
        'deviation': np.abs(means).max(axis=0) / np.maximum(span, 1e-300),
        'clear': span > 3.0 * np.nanstd(residual, axis=0),
    }
