# SPDX-License-Identifier: Apache-2.0
"""Whether recordings that do not name their device look like one device."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import INERTIAL_SENSORS
from thermal_comp.data.prepared_run import PreparedRun

TELLING_SENSORS = INERTIAL_SENSORS
"""Sensors whose temperature slopes differ from device to device far more than from run to run
(Betta et al. 2022, Tables III and IV); a magnetometer's follow the field around it."""
SLOPE_DIFFERENCE_SHARE = 0.5
"""Difference of two slopes, as a share of the larger, from which an axis speaks for two
devices."""
UNLIKE_AXES_SHARE = 0.6
"""Share of such axes from which runs are of two devices."""
SLOPE_DIFFERENCE_SIGMA = 10.0
"""Least difference, in standard errors of independent residuals."""


def unnamed_warning(runs: Sequence[PreparedRun]) -> str:
    """Return a warning where several runs that name no device are fitted together, else ''."""
    unnamed = [run for run in runs if not run.device]
    if len(unnamed) < 2:
        return ''
    way = "name each bag's device (recorder parameter device, or custom_data of the bag)"
    slopes = [_slopes(run) for run in unnamed]
    for run, (slope, error) in zip(unnamed[1:], slopes[1:], strict=True):
        first, first_error = slopes[0]
        apart = np.abs(slope - first)
        unlike = apart > SLOPE_DIFFERENCE_SHARE * np.maximum(np.abs(slope), np.abs(first))
        unlike &= apart > SLOPE_DIFFERENCE_SIGMA * np.hypot(error, first_error)
        axes = int(np.isfinite(apart).sum())
        if axes and unlike.sum() > UNLIKE_AXES_SHARE * axes:
            return (
                f'runs {unnamed[0].name} and {run.name} name no device and look like two: '
                f'{int(unlike.sum())} of {axes} axes change differently with temperature; fit '
                f'each by itself, or {way}'
            )
    return f'{len(unnamed)} runs name no device and are taken to be of one; else {way}'


def _slopes(run: PreparedRun) -> tuple[FloatArray, FloatArray]:
    """Return slope and its standard error of each axis against die temperature [unit/K]."""
    slopes, errors = [], []
    for sensor in TELLING_SENSORS:
        values = run.measured[sensor]
        valid = run.valid(sensor)
        centred = run.temperature[valid] - run.temperature[valid].mean() if valid.any() else None
        if centred is None or valid.sum() < 3 or not centred.any():
            slopes.append(np.full(3, np.nan))
            errors.append(np.full(3, np.nan))
            continue
        y = values[valid] - values[valid].mean(axis=0)
        square = float(centred @ centred)
        slope = centred @ y / square
        left = y - centred[:, np.newaxis] * slope
        slopes.append(slope)
        errors.append(np.sqrt((left**2).sum(axis=0) / (len(y) - 2) / square))
    return np.concatenate(slopes), np.concatenate(errors)
