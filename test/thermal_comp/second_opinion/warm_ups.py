# SPDX-License-Identifier: Apache-2.0
"""Logs of a board that warms up, with or without the way back."""

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

RATE_HZ = 5.0
RAMP_S = 2400.0
SLOPE = np.array([3e-3, -2e-3, 4e-3])
LAG_S = 150.0
NOISE = 2e-3


def warmed(*, back: bool, lag: bool, seed: int = 1) -> tuple[ImuRecording, FloatArray]:
    """A warm-up from 0 to 40 °C, with or without the way back, and its error without noise.

    The accelerometer's elements follow the thermometer with a lag, step by step, or a curve of
    temperature stands in its place.
    """
    time = np.arange(0.0, RAMP_S * (2.0 if back else 1.0), 1.0 / RATE_HZ)
    temperature = 40.0 * (1.0 - np.abs(time / RAMP_S - 1.0))
    element, followed = temperature[0], np.empty_like(temperature)
    for k, value in enumerate(temperature):
        element += (value - element) * (1.0 - np.exp(-1.0 / (RATE_HZ * LAG_S)))
        followed[k] = element
    error = np.outer(followed if lag else temperature + 0.01 * temperature**2, SLOPE)
    rng = np.random.default_rng(seed)
    force = np.array([0.0, 0.0, 9.80665]) + error + rng.normal(0.0, NOISE, error.shape)
    turn = rng.normal(0.0, 1e-4, error.shape) + np.outer(temperature, SLOPE) * 1e-2
    recording = ImuRecording(
        stamp=(1e9 * time).astype(np.int64),
        angular_velocity=turn,
        linear_acceleration=force,
        magnetic_field=np.full_like(force, np.nan),
        temperature=temperature + rng.normal(0.0, 0.02, len(time)),
        device='board',
        up_axis='+z',
    )
    return recording, error
