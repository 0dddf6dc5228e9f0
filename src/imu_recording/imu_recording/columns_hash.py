# SPDX-License-Identifier: Apache-2.0
"""One hash for what was measured, whatever file it came from."""

from __future__ import annotations

import hashlib
from dataclasses import fields

import numpy as np

from imu_recording.recording import ImuRecording

NAN = np.array(np.nan)


def columns_hash(recording: ImuRecording) -> str:
    """Return the SHA-256 of the decoded columns, in hexadecimal.

    Hashed are, in order of the fields of ImuRecording, the name of every track that is present
    and its values, row by row, as little-endian 64-bit numbers; every NaN counts as the same.
    Names, namespaces, paths and the stamps of held temperatures do not enter.
    """
    digest = hashlib.sha256()
    for item in fields(recording):
        column = getattr(recording, item.name)
        if isinstance(column, np.ndarray) and item.name != 'temperature_stamp':
            digest.update(item.name.encode())
            digest.update(np.ascontiguousarray(_canonical(column)).data)
    return digest.hexdigest()


def _canonical(column: np.ndarray) -> np.ndarray:
    """Return the column as little-endian 64-bit numbers with one bit pattern for NaN."""
    if column.dtype.kind == 'i':
        return column.astype('<i8', copy=False)
    column = column.astype('<f8', copy=False)
    missing = np.isnan(column)
    return np.where(missing, NAN, column) if missing.any() else column
