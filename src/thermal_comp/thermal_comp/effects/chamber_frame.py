# SPDX-License-Identifier: Apache-2.0
"""A quantity fixed in the chamber, as a sensor sees it."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.conditions import Conditions


def chamber_field(conditions: Conditions, amount: FloatArray) -> FloatArray:
    """Return (n, 3, 3): amount (n,) × unit vector along each chamber axis, in sensor axes."""
    orientation = conditions.orientation
    assert orientation is not None  # noqa: S101 (effects that use it declare the channel)
    columns: FloatArray = amount[:, None, None] * np.asarray(orientation)[None, :, :]
    return columns


def chamber_and_device_field(conditions: Conditions, amount: FloatArray) -> FloatArray:
    """Return (n, 3, 6): amount × unit vector along each chamber axis, then each sensor axis.

    Currents also return through leads and iron that turn with the device.
    """
    fixed = chamber_field(conditions, amount)
    turning = amount[:, None, None] * np.eye(3)[None, :, :]
    return np.concatenate([fixed, turning], axis=2)
