# SPDX-License-Identifier: Apache-2.0
"""What the scripts of PX4 and ArduPilot fit to the log of one warm-up.

Both take a polynomial of third order in temperature, of all samples, by ordinary least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from imu_recording.recording import FloatArray
from scipy.signal import medfilt

from thermal_comp.data.conditions import Sensor
from thermal_comp.export.ardupilot import PARAMETER_PER_COEFFICIENT, REFERENCE_TEMPERATURE
from thermal_comp.export.cubic import POLYNOMIAL_ORDER, Cubic

Autopilot = Literal['px4', 'ardupilot']
PX4_MEDIAN_ROWS, PX4_BINS = 31, 2000
"""Rows of the running median, and bins of temperature."""
ARDUPILOT_WINDOW_S = 2
"""Length of the moving average [s]."""
ARDUPILOT_DECIMALS = 9
"""Of the scaled coefficients in the parameter file; TMIN and TMAX have one."""

AutopilotFit = Callable[[FloatArray, FloatArray, FloatArray, Sensor], Cubic]
"""A script's fit, of time (n,) [s], temperature (n,) [°C], values (n, 3) [unit] and sensor."""


def px4_fit(
    _time: FloatArray, temperature: FloatArray, values: FloatArray, sensor: Sensor
) -> Cubic:
    """Return what PX4's Tools/process_sensor_caldata.py fits.

    Samples pass a running median and are averaged in 2000 bins of temperature; the polynomial is
    about the middle of the range, an accelerometer's that of the distance from its median.
    """
    low, high = float(temperature.min()), float(temperature.max())
    middle = 0.5 * (low + high)
    smooth = np.stack([medfilt(column, PX4_MEDIAN_ROWS) for column in values.T], axis=1)
    if sensor == 'accelerometer':
        smooth -= np.median(smooth, axis=0)
    x = temperature - middle
    width = (x.max() - x.min()) / PX4_BINS
    place = np.minimum(((x - x.min()) / width).astype(int), PX4_BINS - 1)
    count = np.bincount(place, minlength=PX4_BINS)
    some = count > 0
    means = [np.bincount(place, column, PX4_BINS)[some] / count[some] for column in (x, *smooth.T)]
    powers = np.polyfit(means[0], np.stack(means[1:], axis=1), POLYNOMIAL_ORDER)[::-1]
    return Cubic(coefficients=powers, reference=middle, low=low, high=high)


def ardupilot_fit(
    time: FloatArray, temperature: FloatArray, values: FloatArray, _sensor: Sensor
) -> Cubic:
    """Return what ArduPilot's Tools/scripts/tempcal_IMU.py fits to IMU messages.

    Samples pass a moving average of 2 s; the polynomial is about 35 °C, without its constant,
    which the offset calibration takes; coefficients and range are rounded as in its file.
    """
    rate = int(len(time) / (time[-1] - time[0]))
    window = rate * ARDUPILOT_WINDOW_S
    columns = np.column_stack([temperature, values])
    if window > 1:
        total = np.cumsum(columns, axis=0)
        total[window:] -= total[:-window].copy()
        columns = total[window - 1 :] / window
    x = columns[:, 0]
    powers = np.polyfit(x - REFERENCE_TEMPERATURE, columns[:, 1:], POLYNOMIAL_ORDER)[::-1]
    powers[0] = 0.0
    rounded = (
        np.round(powers * PARAMETER_PER_COEFFICIENT, ARDUPILOT_DECIMALS)
        / PARAMETER_PER_COEFFICIENT
    )
    low, high = round(float(x.min()), 1), round(float(x.max()), 1)
    return Cubic(coefficients=rounded, reference=REFERENCE_TEMPERATURE, low=low, high=high)


AUTOPILOT_FITS: Mapping[Autopilot, AutopilotFit] = {'px4': px4_fit, 'ardupilot': ardupilot_fit}
"""Autopilot → what its script fits."""
