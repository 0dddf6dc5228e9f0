# SPDX-License-Identifier: Apache-2.0
"""Whitened columns of many effects beside the whitened residual, and the χ² each would explain."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import SpectralLine, spectral_lines
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import (
    LEAST_NEW_LENGTH,
    LEAST_NEW_POWER,
    log_volume,
    orthonormal,
    per_axis,
    project_out,
    stack_runs,
)
from thermal_comp.linear.normal_equations import pseudo_solve
from thermal_comp.linear.whitening import RowWhitening, apply_gains, apply_transposed
from thermal_comp.model.values import NoiseModel


class ColumnSource:
    """Columns of effects as block means, kept, because several sensors and steps need the same.

    They are those of the smoothed temperature: a diagnosis has the whole run before it and need
    not be causal, and what the thermometer's noise does to rates, short lags and plays would make
    one of them look better than the other. The noise itself is a column of every design.
    """

    def __init__(
        self,
        runs: Sequence[PreparedRun],
        lines: Mapping[Sensor, Sequence[SpectralLine]] | None = None,
    ) -> None:
        """`lines` are those of the spectrum, where they are known."""
        self.runs = list(runs)
        self._lines = dict(lines or {})
        self.smoothed = [run.smoothed for run in self.runs]
        """The runs with the smoothed temperature."""
        self.temperature_noise = [
            smooth.temperature - run.temperature
            for run, smooth in zip(self.runs, self.smoothed, strict=True)
        ]
        """(m,) per run: smoothed minus measured temperature [K]."""
        self._conditions: dict[Sensor, list[Conditions]] = {}
        self._kept: dict[tuple[Effect, Sensor], list[FloatArray]] = {}

    def spectral_lines(self, sensor: Sensor) -> Sequence[SpectralLine]:
        """Return the most prominent lines of a sensor's spectrum, strongest first."""
        if sensor not in self._lines:
            self._lines[sensor] = spectral_lines(self.runs, sensor)
        return self._lines[sensor]

    def columns(self, effect: Effect, sensor: Sensor) -> list[FloatArray]:
        """Return the effect's (m, p) or (m, 3, p) columns of each run."""
        key = (effect, sensor)
        if key not in self._kept:
            if sensor not in self._conditions:
                self._conditions[sensor] = [run.conditions.of(sensor) for run in self.smoothed]
            self._kept[key] = [
                run.block_mean(effect.columns_in_hindsight(conditions))
                for run, conditions in zip(self.smoothed, self._conditions[sensor], strict=True)
            ]
        return self._kept[key]


COLUMNS_AT_A_TIME = 8
"""Columns that are whitened together: they stay in the processor's cache."""
FIRST_COLUMN_CAPACITY = 2048
"""Columns there is room for at first; memory that is not written to costs nothing."""


@dataclass(frozen=True)
class ColumnGroup:
    """Columns of the design that belong together: one effect in one form."""

    columns: tuple[int, ...]
    shared: bool = False
    """True where the three axes share the coefficients; else each axis has its own."""


class CandidateDesign:
    """Whitened columns of one sensor, orthogonal to a base model, with their normal matrices.

    Rows of all runs stand below each other; every axis has a matrix of its own, because its noise
    is its own and because an effect's column may differ between axes. Of the products of columns
    those of one term are known at once; others are computed when they are first asked for.
    """

    def __init__(
        self,
        source: ColumnSource,
        sensor: Sensor,
        noise: NoiseModel,
        base: Sequence[Effect],
        values: Sequence[FloatArray] | None = None,
        axes: FloatArray | None = None,
    ) -> None:
        """`values` (m, 3) per run replace the measured block means, as draws of noise do.

        `axes` (3, 3), columns of unit length, are the directions in which the noise is
        independent, and to which `noise` belongs; None: those of the sensor.
        """
        self.source, self.sensor, self.noise = source, sensor, noise
        self.axes = np.eye(3) if axes is None else axes
        runs = source.runs
        measured = [run.measured[sensor] for run in runs] if values is None else list(values)
        measured = [rows @ self.axes for rows in measured]
        self.valid = [np.isfinite(rows).all(axis=1) for rows in measured]
        slots = [run.slot[ok] for run, ok in zip(runs, self.valid, strict=True)]
        vibrations = [
            None if run.vibration is None else run.vibration[ok]
            for run, ok in zip(runs, self.valid, strict=True)
        ]
        noises = [noise.of_run(run.name) for run in runs]
        self.whitening = RowWhitening(slots, noises, [run.period for run in runs], vibrations)
        self.rows = len(self.whitening)
        self.cv_group: IntArray = np.concatenate(
            [run.cv_group[ok] for run, ok in zip(runs, self.valid, strict=True)]
        )
        self._terms: dict[Effect, ColumnGroup] = {}
        self._columns = np.empty((3, FIRST_COLUMN_CAPACITY, self.rows))
        self._normal = np.zeros((3, FIRST_COLUMN_CAPACITY, FIRST_COLUMN_CAPACITY))
        self._known = np.zeros((FIRST_COLUMN_CAPACITY, FIRST_COLUMN_CAPACITY), dtype=bool)
        self.right = np.zeros((3, FIRST_COLUMN_CAPACITY))
        self._size = np.zeros(0)
        self.width = 0
        self._further_chi_square = 0.0
        levels = [
            np.column_stack([np.ones(int(ok.sum())), run.after_gaps[ok]])
            for run, ok in zip(runs, self.valid, strict=True)
        ]
        known = [per_axis(stack_runs(levels, per_run=True))[0], self._thermometer_noise()]
        known += [per_axis(self._evaluated(effect))[0] for effect in base]
        whitened = self.whitening.whitened(np.concatenate(known, axis=2))
        self.base = [orthonormal(columns) for columns in whitened]
        self.log_density = -self.whitening.log_deviations - sum(map(log_volume, whitened))
        """ln of the density of the rows less −χ²/2: of their noise, levels and base model."""
        self.base_rank = sum(q.shape[1] for q in self.base)
        self.target = self._residual(measured)

    @contextmanager
    def trials(self) -> Iterator[None]:
        """Forget, at the end, the columns made inside: shapes are moved by the hundred."""
        before = self.width, self._size, self._terms
        self._terms = dict(self._terms)
        try:
            yield
        finally:
            self.width, self._size, self._terms = before

    def inform(self, term: ColumnGroup, normal: FloatArray, right: FloatArray) -> float:
        """Take equations of a shared term's coefficients, in their own units, as further rows.

        Returns the χ² they add: what the coefficients they speak for explain of them.
        """
        size = self._size[list(term.columns)]
        inverse = np.where(size > 0.0, 1.0 / np.maximum(size, 1e-300), 0.0)
        further = normal * np.outer(inverse, inverse)
        answer = np.linalg.pinv(further, rcond=LEAST_NEW_POWER, hermitian=True) @ (right * inverse)
        added = further @ answer
        index = list(term.columns)
        self._normal[0][np.ix_(index, index)] += further
        self.right[0, index] += added
        self._further_chi_square += float(answer @ added)
        return float(answer @ added)

    @property
    def chi_square(self) -> float:
        """χ² of the residual of the base model."""
        return float((self.target**2).sum()) + self._further_chi_square

    def term(self, effect: Effect) -> ColumnGroup:
        """Return the effect's columns in the design, computed on first use."""
        return self.terms([effect])[0]

    def terms(self, effects: Sequence[Effect]) -> list[ColumnGroup]:
        """Return the columns of several effects, computed together where they are new."""
        new = [effect for effect in dict.fromkeys(effects) if effect not in self._terms]
        if new:
            evaluated = [per_axis(self._evaluated(effect)) for effect in new]
            place = self._append([columns for columns, _ in evaluated])
            for effect, (columns, shared) in zip(new, evaluated, strict=True):
                stop = place + columns.shape[2]
                self._terms[effect] = ColumnGroup(tuple(range(place, stop)), shared)
                place = stop
        return [self._terms[effect] for effect in effects]

    def generic_terms(
        self,
        functions: Sequence[tuple[Callable[[PreparedRun], FloatArray], bool]],
        runs: Sequence[PreparedRun] = (),
    ) -> list[ColumnGroup]:
        """Return the columns (m, p) or (m, 3, p) each function makes of a run; True: per run.

        `runs` stand for those of the source, as with the smoothed temperature.
        """
        made = []
        for function, per_run in functions:
            parts = zip(runs or self.source.runs, self.valid, strict=True)
            columns = stack_runs([function(run)[ok] for run, ok in parts], per_run=per_run)
            start = self._append([per_axis(columns)[0]])
            made.append(ColumnGroup(tuple(range(start, self.width))))
        return made

    def equations(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrices (3, k, k) of k columns and their right-hand sides (3, k)."""
        index = np.array(columns, dtype=np.int64)
        self._multiply(index, index)
        return self._normal[:, index[:, None], index], self.right[:, index]

    def products(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return normal matrices (3, c, c) and right-hand sides (3, c) of all columns, as views.

        They hold the products of `columns` with all others and those of each term, no others.
        """
        self._multiply(np.array(columns, dtype=np.int64), np.arange(self.width))
        return self._normal[:, : self.width, : self.width], self.right[:, : self.width]

    def _multiply(self, one: IntArray, other: IntArray) -> None:
        """Compute the products of columns with others that are not known yet."""
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
            # Products that other sensors have informed are known and stay.
            found = np.where(new, self._products(left, right), self._normal[:, *block])
            self._normal[:, *block] = found
            self._normal[:, *mirrored] = found.transpose(0, 2, 1)
            self._known[block] = self._known[mirrored] = True

    def _products(self, left: IntArray, right: IntArray) -> FloatArray:
        """Return (3, l, r) products of columns with others; the more numerous are not copied."""
        if len(left) > len(right):
            return self._products(right, left).transpose(0, 2, 1)
        few = self._columns[:, _rows(left)]
        neighbours = np.split(right, np.flatnonzero(np.diff(right) != 1) + 1)
        many = (self._columns[:, some[0] : some[-1] + 1] for some in neighbours)
        return np.concatenate([few @ some.transpose(0, 2, 1) for some in many], axis=2)

    def size_of(self, term: ColumnGroup) -> FloatArray:
        """(p,) norm of the term's whitened columns before they were made one long."""
        return np.asarray(self._size[list(term.columns)])

    def solve(self, terms: Sequence[ColumnGroup]) -> tuple[float, int]:
        """Return the χ² the terms explain together and the rank they use."""
        own, common = self._split(terms)
        delta_chi2, rank, shared_normal, shared_right = self._eliminated(own, common)
        if common:
            full = self._normal[:, common, common].sum(axis=0)
            answer, used = pseudo_solve(shared_normal, shared_right[:, None], full)
            delta_chi2 += float(shared_right @ answer[:, 0])
            rank += used
        return delta_chi2, rank

    def _eliminated(
        self, own: list[int], common: list[int]
    ) -> tuple[float, int, FloatArray, FloatArray]:
        """Return χ² and rank of each axis's own columns, and the equations of those shared."""
        delta_chi2, rank = 0.0, 0
        normal, right = self.equations([*own, *common])
        first, size = len(own), len(common)
        shared_normal, shared_right = np.zeros((size, size)), np.zeros(size)
        for axis in range(3):
            rows, cross = right[axis, :first], normal[axis, :first, first:]
            block = normal[axis, :first, :first]
            answer, used = pseudo_solve(block, np.column_stack([rows, cross]))
            delta_chi2 += float(rows @ answer[:, 0])
            rank += used
            shared_normal += normal[axis, first:, first:] - cross.T @ answer[:, 1:]
            shared_right += right[axis, first:] - answer[:, 1:].T @ rows
        return delta_chi2, rank, shared_normal, shared_right

    def reduced(
        self, known: Sequence[int], columns: Sequence[int]
    ) -> tuple[FloatArray, FloatArray]:
        """Return normal matrices (3, k, k) and right-hand sides (3, k) with `known` taken out."""
        first = len(known)
        normal, right = self.equations([*known, *columns])
        left, left_right = normal[:, first:, first:].copy(), right[:, first:].copy()
        for axis in range(3):
            cross = normal[axis, :first, first:]
            sides = np.column_stack([right[axis, :first], cross])
            answer, _ = pseudo_solve(normal[axis, :first, :first], sides)
            left[axis] -= cross.T @ answer[:, 1:]
            left_right[axis] -= cross.T @ answer[:, 0]
        return left, left_right

    def whitened_columns(self, terms: Sequence[ColumnGroup]) -> list[FloatArray]:
        """Return per axis the (rows, p) whitened columns, those shared last."""
        own, common = self._split(terms)
        return [self._columns[axis][[*own, *common]].T for axis in range(3)]

    def residual(self, terms: Sequence[ColumnGroup] = ()) -> FloatArray:
        """Return (3, rows) what terms leave of the base model's residual, each axis by itself."""
        if not terms:
            return self.target
        return np.stack([
            project_out(orthonormal(known), target)
            for known, target in zip(self.whitened_columns(terms), self.target, strict=True)
        ])  # fmt: skip

    def transposed(self, run: int, residual: FloatArray) -> FloatArray:
        """Return (m, 3) Wᵀ of a residual (3, rows) in one run; W whitens, m are its valid rows."""
        rows = self.whitening.rows_of(run)
        columns = [
            apply_transposed(residual[axis, rows, None], self.whitening.gains_of(run, axis))
            for axis in range(3)
        ]
        return np.concatenate(columns, axis=1)

    def whitened_in_run(
        self, columns: FloatArray, run: int, axis: int, first: int = 0
    ) -> tuple[FloatArray, slice]:
        """Return columns (m − first, q), zero before block `first`, whitened, and their rows.

        They are those of one run's blocks; what is not valid is left out.
        """
        valid, rows = self.valid[run], self.whitening.rows_of(run)
        before = int(valid[:first].sum())
        gains = self.whitening.gains_of(run, axis).since(before)
        return apply_gains(columns[valid[first:]], gains), slice(rows.start + before, rows.stop)

    @staticmethod
    def _split(terms: Sequence[ColumnGroup]) -> tuple[list[int], list[int]]:
        own = [c for term in terms if not term.shared for c in term.columns]
        common = [c for term in terms if term.shared for c in term.columns]
        return own, common

    def _evaluated(self, effect: Effect) -> FloatArray:
        """Return the effect's (rows, p) or (rows, 3, p) columns; per run, p of each run."""
        columns = self.source.columns(effect, self.sensor)
        parts = [part[ok] for part, ok in zip(columns, self.valid, strict=True)]
        whole = stack_runs(parts, per_run=effect.per_run)
        if whole.ndim == 3 and not np.array_equal(self.axes, np.eye(3)):
            alone, shared = per_axis(whole)
            if effect.channels and not shared:
                # A channel's own noise weakens its coefficient by as much along no other axes.
                return alone.reshape(len(whole), -1)
            return np.asarray(np.einsum('nap,ab->nbp', whole, self.axes))
        return whole

    def _thermometer_noise(self) -> FloatArray:
        """(rows, 3, 1) smoothed minus measured temperature: times the slope it is error."""
        noises = self.source.temperature_noise
        parts = [noise[ok] for noise, ok in zip(noises, self.valid, strict=True)]
        return np.repeat(np.concatenate(parts)[:, None, None], 3, axis=1)

    def _residual(self, values: Sequence[FloatArray]) -> FloatArray:
        """(3, rows) values (m, 3) per run, whitened, the base model taken out."""
        valid = [rows[ok] for rows, ok in zip(values, self.valid, strict=True)]
        whitened = self.whitening.whitened(np.concatenate(valid)[:, :, None])
        return np.stack(
            [project_out(*pair)[:, 0] for pair in zip(self.base, whitened, strict=True)]
        )

    def _append(self, parts: Sequence[FloatArray]) -> int:
        """Whiten, project and keep columns (rows, 3, p) of several parts; return their start."""
        start = self.width
        own, first = [], start
        for part in parts:
            own.append(slice(first, first + part.shape[2]))
            first = own[-1].stop
        stop = self.width = first
        self._grow(stop)
        for axis, columns in enumerate(self._columns):
            for part, place in zip(parts, own, strict=True):
                columns[place] = part[:, axis].T
        before, left = np.zeros((2, stop - start))
        for axis, columns in enumerate(self._columns):
            for first in range(start, stop, COLUMNS_AT_A_TIME):
                place = slice(first, min(first + COLUMNS_AT_A_TIME, stop))
                new = columns[place]
                self.whitening.whiten_in_place(new, axis)
                before[place.start - start : place.stop - start] += _power(new)
                new -= (new @ self.base[axis]) @ self.base[axis].T
                left[place.start - start : place.stop - start] += _power(new)
        before, size = np.sqrt(before), np.sqrt(left)
        scale = np.where(size > LEAST_NEW_LENGTH * before, 1.0 / np.maximum(size, 1e-300), 0.0)
        self._size = np.concatenate([self._size, size])
        self._known[start:stop, :stop] = self._known[:stop, start:stop] = False
        for axis, columns in enumerate(self._columns):
            columns[start:stop] *= scale[:, None]
            self.right[axis, start:stop] = columns[start:stop] @ self.target[axis]
            for place in own:
                self._normal[axis, place, place] = columns[place] @ columns[place].T
        for place in own:
            self._known[place, place] = True
        return start

    def _grow(self, width: int) -> None:
        room = self._columns.shape[1]
        if width > room:
            more = max(room // 2, width - room)
            self._columns = np.pad(self._columns, ((0, 0), (0, more), (0, 0)))
            self._normal = np.pad(self._normal, ((0, 0), (0, more), (0, more)))
            self._known = np.pad(self._known, (0, more))
            self.right = np.pad(self.right, ((0, 0), (0, more)))


def _power(columns: FloatArray) -> FloatArray:
    """Return the sums of squares of columns (p, rows)."""
    return np.asarray(np.einsum('pn,pn->p', columns, columns))


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
