# SPDX-License-Identifier: Apache-2.0
"""Logs of a device that was parked for a minute each, a few kelvin warmer every time."""

import numpy as np
from scipy.spatial.transform import Rotation

from imu_recording import ImuRecording

RATE, SECONDS, LOGS, G = 10.0, 60.0, 12, 9.80665
OFFSET = np.array([0.4, -0.4, 0.0])
SLOPE = np.array([8e-3, -8e-3, 0.0])
"""Error of the accelerometer at 0 °C and per kelvin [m/s²]: none along gravity."""


def parked(number: int) -> ImuRecording:
    """A minute at rest, a few kelvin warmer than the log before, tilted by some degrees."""
    rng = np.random.default_rng([number, 4])
    n = round(RATE * SECONDS)
    temperature = 4.0 * number + np.linspace(0.0, 0.5, n)
    tilt = Rotation.from_euler('xy', rng.normal(0.0, 4.0, 2), degrees=True)
    error = OFFSET + SLOPE * temperature[:, None] + 1e-3 * rng.standard_normal(3)
    noise = rng.standard_normal((2, n, 3))
    return ImuRecording(
        stamp=np.round(np.arange(n) * (1e9 / RATE)).astype(np.int64),
        linear_acceleration=tilt.apply([0.0, 0.0, G]) + error + 2e-3 * noise[0],
        angular_velocity=1e-3 * noise[1],
        magnetic_field=np.full((n, 3), np.nan),
        temperature=temperature,
        device='quad',
        run=f'log{number}',
    )
