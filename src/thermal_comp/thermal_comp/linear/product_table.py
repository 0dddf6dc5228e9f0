# SPDX-License-Identifier: Apache-2.0
"""Columns of three axes that grow by the hundred, and their products with each other on demand."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

FIRST_COLUMN_CAPACITY = 2048
"""Columns there is room for at first; memory that is not written to costs nothing."""


class ProductTable:
    """Columns over rows, axis by axis, with products that are computed once, when asked for.

    Columns are appended in groups, filled in place by who appends them, and then `settle`.
    """

    def __init__(self, rows: int) -> None:
        room = FIRST_COLUMN_CAPACITY
        self.width = 0
        """Columns that count; who lowers it forgets the last ones."""
        self.columns = np.empty((3, room, rows))
        """(3, …, rows), each column lies contiguously."""
        self._normal = np.zeros((3, room, room))
        self._known = np.zeros((room, room), dtype=bool)
        self._right = np.zeros((3, room))

    def append(self, groups: Sequence[FloatArray]) -> list[slice]:
        """Append groups of columns (rows, 3, p); return where each stands."""
        edges = np.cumsum([self.width, *(group.shape[2] for group in groups)]).tolist()
        self.width = edges[-1]
        self._grow(self.width)
        places = [slice(*edge) for edge in pairwise(edges)]
        for axis, columns in enumerate(self.columns):
            for group, place in zip(groups, places, strict=True):
                columns[place] = group[:, axis].T
        return places

    def settle(self, places: Sequence[slice], target: FloatArray) -> None:
        """Take in the columns of new groups as they are now, and a target (3, rows)."""
        new = slice(places[0].start, places[-1].stop)
        self._known[new, : new.stop] = self._known[: new.stop, new] = False
        for axis, columns in enumerate(self.columns):
            self._right[axis, new] = columns[new] @ target[axis]
            for place in places:
                self._normal[axis, place, place] = columns[place] @ columns[place].T
        for place in places:
            self._known[place, place] = True

    def add(self, columns: Sequence[int], normal: FloatArray, right: FloatArray) -> None:
        """Add further equations (k, k) and (k,) to those of k columns of one group."""
        index = np.array(columns, dtype=np.int64)
        self._normal[0][np.ix_(index, index)] += normal
        self._right[0, index] += right

    def equations(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrices (3, k, k) of k columns and their right-hand sides (3, k)."""
        index = np.array(columns, dtype=np.int64)
        self._multiply(index, index)
        return self._normal[:, index[:, None], index], self._right[:, index]

    def products_among(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return normal matrices (3, …, …) and right-hand sides (3, …) of all there is room for.

        They hold the products of `columns` with each other.
        """
        index = np.array(columns, dtype=np.int64)
        self._multiply(index, index)
        return self._normal, self._right

    def products(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return normal matrices (3, c, c) and right-hand sides (3, c) of all columns, as views.

        They hold the products of `columns` with all others and those of each group, no others.
        """
        self._multiply(np.array(columns, dtype=np.int64), np.arange(self.width))
        return self._normal[:, : self.width, : self.width], self._right[:, : self.width]

    def _multiply(self, one: IntArray, other: IntArray) -> None:
        """Compute the products of columns with others that are not known yet."""
        if _all_known(self._known, one, other):
            return
        for least_share in (0.5, 0.0):  # few columns with many others, then many with few
            lacking = ~self._known[one[:, None], other]
            if not lacking.any():
                return
            rows = np.flatnonzero(lacking.sum(axis=1) > least_share * len(other))
            if not len(rows):
                continue
            place = np.flatnonzero(lacking[rows].any(axis=0))
            if least_share and _neighbours(other):
                # A product too many takes less time than a copy of the columns about it.
                place = np.arange(place[0], place[-1] + 1)
            new = lacking[rows[:, None], place]
            left, right = one[rows], other[place]
            block, mirrored = _block(left, right), _block(right, left)
            # Products that something was added to are known and stay.
            found = np.where(new, self._products(left, right), self._normal[:, *block])
            self._normal[:, *block] = found
            self._normal[:, *mirrored] = found.transpose(0, 2, 1)
            self._known[block] = self._known[mirrored] = True

    def _products(self, left: IntArray, right: IntArray) -> FloatArray:
        """Return (3, l, r) products of columns with others; the more numerous are not copied."""
        if len(left) > len(right):
            return self._products(right, left).transpose(0, 2, 1)
        few = self.columns[:, _rows(left)]
        neighbours = np.split(right, np.flatnonzero(np.diff(right) != 1) + 1)
        many = (self.columns[:, some[0] : some[-1] + 1] for some in neighbours)
        return np.concatenate([few @ some.transpose(0, 2, 1) for some in many], axis=2)

    def _grow(self, width: int) -> None:
        room = self.columns.shape[1]
        if width > room:
            more = max(room // 2, width - room)
            self.columns = np.pad(self.columns, ((0, 0), (0, more), (0, 0)))
            self._normal = np.pad(self._normal, ((0, 0), (0, more), (0, more)))
            self._known = np.pad(self._known, (0, more))
            self._right = np.pad(self._right, ((0, 0), (0, more)))


@njit(cache=True, nogil=True)
def _all_known(known: NDArray[np.bool_], one: IntArray, other: IntArray) -> bool:
    """Tell whether the products of all columns with all others are known."""
    for row in one:
        for column in other:
            if not known[row, column]:
                return False
    return True


def _neighbours(index: IntArray) -> bool:
    """Tell whether every index follows the one before."""
    span = index[-1] - index[0] == len(index) - 1
    return bool(span and (index[1:] > index[:-1]).all())


def _rows(index: IntArray) -> slice | IntArray:
    """Return an index of rows, a slice where they are neighbours: it copies nothing."""
    return slice(index[0], index[-1] + 1) if _neighbours(index) else index


def _block(rows: IntArray, columns: IntArray) -> tuple[slice | IntArray, slice | IntArray]:
    """Return the index of all elements of a matrix in given rows and columns."""
    first, second = _rows(rows), _rows(columns)
    if isinstance(first, slice) or isinstance(second, slice):
        return first, second
    return first[:, None], second
