# SPDX-License-Identifier: Apache-2.0
"""Means over blocks of samples of a stream that comes in pieces, for long logs."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from imu_recording.recording import FloatArray, IntArray


class BlockMeans:
    """Means over `count` samples in a row, kept as single columns, whatever the pieces are.

    A clock that steps back begins a block anew; what is left of the one before is dropped.

    >>> means = BlockMeans(2)
    >>> means.add(np.array([0, 10, 20]), {'x': np.array([1.0, 3.0, 5.0])})
    >>> means.add(np.array([30, 5, 15]), {'x': np.array([7.0, 2.0, 4.0])})
    >>> time, columns = means.result()
    >>> time, columns['x']
    (array([ 5, 25, 10]), array([2., 6., 3.]))
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._time: list[IntArray] = []
        self._values: dict[str, list[FloatArray]] = {}
        self._rest_time = np.zeros(0, np.int64)
        self._rest: dict[str, FloatArray] = {}

    def add(self, time: IntArray, columns: Mapping[str, FloatArray]) -> None:
        """Take in the next samples: integer times (n,) and columns (n,)."""
        time = np.concatenate([self._rest_time, time])
        joined = {
            name: np.concatenate([self._rest.get(name, np.zeros(0)), values])
            for name, values in columns.items()
        }
        back = np.flatnonzero(np.diff(time) < 0) + 1
        edges = [0, *back.tolist(), len(time)]
        for start, stop in pairwise(edges):
            whole = start + (stop - start) // self._count * self._count
            self._take(time[start:whole], {n: v[start:whole] for n, v in joined.items()})
        rest = edges[-2] + (edges[-1] - edges[-2]) // self._count * self._count
        self._rest_time = time[rest:].copy()
        self._rest = {name: values[rest:].copy() for name, values in joined.items()}

    def _take(self, time: IntArray, columns: Mapping[str, FloatArray]) -> None:
        if not len(time):
            return
        blocks = time.reshape(-1, self._count)
        first = blocks[:, 0]  # means of differences: sums of times may not fit
        self._time.append(first + np.rint((blocks - first[:, None]).mean(axis=1)).astype(np.int64))
        for name, values in columns.items():
            means = values.reshape(-1, self._count).mean(axis=1)
            self._values.setdefault(name, []).append(means)

    def result(self) -> tuple[IntArray, dict[str, FloatArray]]:
        """Return the times and columns of all full blocks."""
        time = np.concatenate([np.zeros(0, np.int64), *self._time])
        return time, {name: np.concatenate(parts) for name, parts in self._values.items()}
