# SPDX-License-Identifier: Apache-2.0
"""Rows of the tracks beside the sensors that hold what cannot be."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import ImuRecording
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]

POSSIBLE = {
    'vibration': (0.0, 1e5, 'is no variance'),
    'humidity': (-0.05, 1.1, 'is no relative humidity (0 … 1)'),
    'temperature': (-80.0, 200.0, 'is no temperature of a working die'),
    'chamber_temperature': (-100.0, 300.0, 'is no temperature of a chamber'),
    'supply_voltage': (0.0, 60.0, 'is no supply voltage'),
}
"""Least and greatest value a track can have [its unit], and what is said of others."""


def impossible_rows(recording: ImuRecording) -> list[tuple[str, BoolArray, str]]:
    """Return track, rows (n,) and a sentence for every track with values that cannot be."""
    found = []
    for name, (low, high, text) in POSSIBLE.items():
        values = getattr(recording, name)
        if values is None:
            continue
        with np.errstate(invalid='ignore'):
            wrong = ((values < low) | (values > high)).reshape(len(values), -1).any(axis=1)
        if wrong.any():
            found.append((name, wrong, text))
    return found
