# SPDX-License-Identifier: Apache-2.0
"""Samples of one topic: decoded in batches, kept half a minute, averaged per second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.bags.decoding.cdr import ENCAPSULATION, LAYOUTS
from imu_recording.recording import SECOND_NS, FloatArray, IntArray


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
        stamp[chosen] = seconds * SECOND_NS + table[:, 8:12].copy().view('<u4')[:, 0]
        body = size - 8 * count
        values[chosen] = table[:, body:].copy().view('<f8')
    for group in layout.columns:
        if group.unreported >= 0:
            silent = values[:, group.unreported] == -1.0
            values[silent, group.first : group.first + group.count] = np.nan
    return Rows(stamp, values), len(messages) - len(fit)


MAX_RECENT_ROWS = 32_768
"""Samples kept as they are: 30 s at 1 kHz."""
MAX_HISTORY_SECONDS = 86_400
"""Seconds kept as means: a day."""


class Recent:
    """The newest samples; the oldest give way."""

    def __init__(self, width: int, capacity: int = MAX_RECENT_ROWS) -> None:
        self._stamp = np.zeros(capacity, np.int64)
        self._values = np.zeros((capacity, width))
        self._written = 0

    def add(self, rows: Rows) -> None:
        """Append rows."""
        capacity = len(self._stamp)
        stamp, values = rows.stamp[-capacity:], rows.values[-capacity:]
        places = (self._written + np.arange(len(stamp))) % capacity
        self._stamp[places], self._values[places] = stamp, values
        self._written += len(stamp)

    def since(self, stamp: int) -> Rows:
        """Return the rows from `stamp` [ns] on, in the order they arrived."""
        oldest = self._written % len(self._stamp) if self._written >= len(self._stamp) else 0
        stamps, values = [], []
        for part in (slice(oldest, self._written if not oldest else None), slice(0, oldest)):
            # Rows are late by less than a second: before that, none is wanted.
            first = int(np.searchsorted(self._stamp[part], stamp - SECOND_NS))
            late = self._stamp[part][first:]
            wanted = late >= stamp
            stamps.append(late[wanted])
            values.append(self._values[part][first:][wanted])
        return Rows(np.concatenate(stamps), np.concatenate(values))


class PerSecond:
    """Mean and standard deviation of every second of stamps."""

    def __init__(self, width: int, capacity: int = MAX_HISTORY_SECONDS) -> None:
        self._capacity = capacity
        self._offset = np.full(width, np.nan)  # near the values: sums of squares keep digits
        self._second = np.zeros(64, np.int64)
        self._sums = np.zeros((64, 3, width))  # count, sum and sum of squares above the offset
        self._count = 0

    def add(self, rows: Rows) -> None:
        """Add rows; those of a second that has left the history are passed over."""
        if not len(rows.stamp):
            return
        self._offset = np.where(np.isnan(self._offset), _first_known(rows.values), self._offset)
        second = rows.stamp // SECOND_NS
        above = rows.values - self._offset
        known = np.isfinite(above)
        above = np.where(known, above, 0.0)
        for value in np.unique(second):
            of_it = second == value
            sums = np.stack([known[of_it].sum(0), above[of_it].sum(0), (above[of_it] ** 2).sum(0)])
            self._add_second(int(value), sums)

    def means(self, first: int = 0, end: int | None = None) -> tuple[IntArray, FloatArray]:
        """Return the seconds (n,) from `first` to before `end`, and their means (n, k)."""
        chosen = self._between(first, end)
        count, total, _ = self._counted(chosen)
        return self._second[chosen].copy(), total / count + self._offset

    def deviations(self, first: int = 0, end: int | None = None) -> FloatArray:
        """Return the standard deviation within every second (n, k)."""
        count, total, squares = self._counted(self._between(first, end))
        variance = squares / count - (total / count) ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    @property
    def oldest(self) -> int:
        """The oldest second that is kept; −1 where there is none."""
        return int(self._second[0]) if self._count else -1

    def _between(self, first: int, end: int | None) -> slice:
        seconds = self._second[: self._count]
        last = self._count if end is None else int(np.searchsorted(seconds, end))
        return slice(int(np.searchsorted(seconds, first)), last)

    def _counted(self, chosen: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
        count, total, squares = np.moveaxis(self._sums[chosen], 1, 0)
        return np.where(count > 0, count, np.nan), total, squares

    def _add_second(self, second: int, sums: FloatArray) -> None:
        place = int(np.searchsorted(self._second[: self._count], second))
        if place < self._count and self._second[place] == second:
            self._sums[place] += sums
        elif place == self._count:
            self._make_room()
            self._second[self._count], self._sums[self._count] = second, sums
            self._count += 1

    def _make_room(self) -> None:
        if self._count == self._capacity:
            kept = self._capacity - self._capacity // 10
            self._second[:kept] = self._second[self._count - kept : self._count]
            self._sums[:kept] = self._sums[self._count - kept : self._count]
            self._count = kept
        if self._count == len(self._second):
            size = min(2 * len(self._second), self._capacity)
            self._second = np.resize(self._second, size)
            self._sums = np.resize(self._sums, (size, *self._sums.shape[1:]))


def _first_known(values: FloatArray) -> FloatArray:
    """Return the first finite value of every column (k,), NaN where there is none."""
    known = np.isfinite(values)
    first = values[known.argmax(0), np.arange(values.shape[1])]
    return np.where(known.any(0), first, np.nan)


class TopicHistory:
    """One topic, or one difference of two."""

    def __init__(self, width: int) -> None:
        self.recent = Recent(width)
        self.history = PerSecond(width)
        self.newest = -1
        """Newest stamp [ns]; −1 before the first."""
        self.received = float('-inf')
        """When the newest arrived [s], by the clock of the state."""

    def add(self, rows: Rows, received: float) -> None:
        """Add rows that arrived now."""
        if len(rows.stamp):
            self.recent.add(rows)
            self.history.add(rows)
            self.newest = max(self.newest, int(rows.stamp.max()))
            self.received = received

    def jumped_back(self, rows: Rows) -> bool:
        """Tell whether rows are from well before what was heard: a bag that starts again."""
        return bool(len(rows.stamp)) and int(rows.stamp.max()) < self.newest - SECOND_NS
