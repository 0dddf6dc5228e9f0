# SPDX-License-Identifier: Apache-2.0
"""Many serialised messages at once into columns: the cost per message is that of a copy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.cdr_layout import ENCAPSULATION, LAYOUTS, NANOSECONDS
from imu_recording.recording import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Rows:
    """Samples of one topic in the order they arrived."""

    stamp: IntArray
    """(n,) time of measurement [ns]."""
    values: FloatArray
    """(n, k) the message's numbers; NaN where it says that it does not report them."""

    @classmethod
    def none(cls, width: int) -> Rows:
        """Return no rows of that many values."""
        return cls(np.zeros(0, np.int64), np.zeros((0, width)))


def decoded(message_type: str, messages: Sequence[bytes]) -> tuple[Rows, int]:
    """Return the rows of stamped messages of one type, and how many could not be read.

    The frame_id may differ between messages: where the doubles begin follows from the length.
    """
    layout = LAYOUTS[message_type]
    count = layout.doubles
    smallest = layout.size(0)
    fit = [m for m in messages if m[:4] == ENCAPSULATION and len(m) >= smallest]
    if not fit:
        return Rows.none(count), len(messages)
    sizes = np.array([len(message) for message in fit])
    stamp = np.empty(len(fit), np.int64)
    values = np.empty((len(fit), count))
    for size in np.unique(sizes):
        chosen = np.flatnonzero(sizes == size)
        joined = b''.join(fit[i] for i in chosen)
        table = np.frombuffer(joined, np.uint8).reshape(len(chosen), size)
        seconds = table[:, 4:8].copy().view('<i4')[:, 0].astype(np.int64)
        stamp[chosen] = seconds * NANOSECONDS + table[:, 8:12].copy().view('<u4')[:, 0]
        body = size - 8 * count
        values[chosen] = table[:, body:].copy().view('<f8')
    for group in layout.columns:
        if group.unreported >= 0:
            silent = values[:, group.unreported] == -1.0
            values[silent, group.first : group.first + group.count] = np.nan
    return Rows(stamp, values), len(messages) - len(fit)
