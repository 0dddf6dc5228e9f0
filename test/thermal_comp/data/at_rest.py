# SPDX-License-Identifier: Apache-2.0
"""A device at rest, made up, for what is cut, averaged and held out of its recording."""

import numpy as np

from imu_recording import ImuRecording

GRAVITY = 9.80665


def still(hours: float, rate_hz: float, *, seed: int = 0, **fields: object) -> ImuRecording:
    """A device at rest with z up whose temperature swings once an hour by ±30 K."""
    n = int(hours * 3600 * rate_hz)
    rng = np.random.default_rng(seed)
    time = np.arange(n) / rate_hz
    force = np.tile([0.1, -0.2, GRAVITY], (n, 1)) + 0.01 * rng.standard_normal((n, 3))
    field = np.tile([2e-5, 1e-6, -4e-5], (n, 1)) + 1e-7 * rng.standard_normal((n, 3))
    parts = {
        'stamp': np.round(time * 1e9).astype(np.int64) + 1_700_000_000_000_000_000,
        'angular_velocity': 1e-4 * rng.standard_normal((n, 3)),
        'linear_acceleration': force,
        'magnetic_field': field,
        'temperature': 20.0 + 30.0 * np.sin(2 * np.pi * time / 3600.0),
        'up_axis': '+z',
        'run': 'z',
    }
    return ImuRecording(**{**parts, **fields})
