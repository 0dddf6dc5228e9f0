# SPDX-License-Identifier: Apache-2.0
"""Whitened columns of many effects beside the whitened residual, and the χ² each would explain."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

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
from thermal_comp.linear.normal_equations import pseudo_solve, taken_out
from thermal_comp.linear.product_table import ProductTable
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


@dataclass(frozen=True)
class ColumnGroup:
    """Columns of the design that belong together: one effect in one form."""

    columns: tuple[int, ...]
    shared: bool = False
    """True where the three axes share the coefficients; else each axis has its own."""


class CandidateDesign:
    """Whitened columns of one sensor, orthogonal to a base model, with their normal matrices.

    Those of the base model whose coefficients the axes share stand among them (`shared_base`).
    Rows of all runs stand below each other; every axis has a matrix of its own, because its noise
    is its own and because an effect's column may differ between axes.
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
        self.whitening = RowWhitening.of_runs(runs, self.valid, noise)
        self.rows = len(self.whitening)
        self._terms: dict[Effect, ColumnGroup] = {}
        self._table = ProductTable(self.rows)
        self._size = np.zeros(0)
        levels = [run.level_columns[ok] for run, ok in zip(runs, self.valid, strict=True)]
        own = [per_axis(stack_runs(levels, per_run=True))[0], self._thermometer_noise()]
        common: list[FloatArray] = []
        for columns, shared in (per_axis(self._evaluated(effect)) for effect in base):
            (common if shared else own).append(columns)
        whitened = self.whitening.whitened(np.concatenate(own, axis=2))
        self.base = [orthonormal(columns) for columns in whitened]
        """(rows, p) of each axis: what other columns are made orthogonal to."""
        self.log_density = -self.whitening.log_deviations - sum(map(log_volume, whitened))
        """ln of the density of the rows less −χ²/2: of their noise, levels and base model."""
        self.base_rank = sum(q.shape[1] for q in self.base)
        self.target = self._residual(measured)
        self.shared_base = ColumnGroup((), shared=True)
        """Columns of the base model whose coefficients the axes share."""
        if common:
            self._take_out_shared(np.concatenate(common, axis=2))
        self.chi_square = float((self.target**2).sum())
        """χ² of the residual of the base model, and of further equations."""

    @contextmanager
    def trials(self) -> Iterator[None]:
        """Forget, at the end, the columns made inside: shapes are moved by the hundred."""
        before = self._table.width, self._size, self._terms
        self._terms = dict(self._terms)
        try:
            yield
        finally:
            self._table.width, self._size, self._terms = before

    def inform(
        self, term: ColumnGroup, normal: FloatArray, right: FloatArray, *, counted: bool = True
    ) -> float:
        """Take equations of a shared term's coefficients, in their own units, as further rows.

        Returns the χ² they add: what the coefficients they speak for explain of them. It is not
        `counted` where a term took them before, in whose place this one stands.
        """
        size = self._size[list(term.columns)]
        inverse = np.where(size > 0.0, 1.0 / np.maximum(size, 1e-300), 0.0)
        further = normal * np.outer(inverse, inverse)
        answer = np.linalg.pinv(further, rcond=LEAST_NEW_POWER, hermitian=True) @ (right * inverse)
        added = further @ answer
        self._table.add(term.columns, further, added)
        self.chi_square += float(answer @ added) if counted else 0.0
        return float(answer @ added)

    def term(self, effect: Effect) -> ColumnGroup:
        """Return the effect's columns in the design, computed on first use."""
        return self.terms([effect])[0]

    def terms(self, effects: Sequence[Effect]) -> list[ColumnGroup]:
        """Return the columns of several effects, computed together where they are new."""
        new = [effect for effect in dict.fromkeys(effects) if effect not in self._terms]
        if new:
            evaluated = [per_axis(self._evaluated(effect)) for effect in new]
            made = self._append([columns for columns, _ in evaluated])
            for effect, group, (_, shared) in zip(new, made, evaluated, strict=True):
                self._terms[effect] = replace(group, shared=shared)
        return [self._terms[effect] for effect in effects]

    def generic_terms(
        self,
        functions: Sequence[tuple[Callable[[PreparedRun], FloatArray], bool]],
        runs: Sequence[PreparedRun] = (),
    ) -> list[ColumnGroup]:
        """Return the columns (m, p) or (m, 3, p) each function makes of a run; True: per run.

        `runs` stand for those of the source, as with the smoothed temperature.
        """
        made: list[ColumnGroup] = []
        for function, per_run in functions:
            parts = zip(runs or self.source.runs, self.valid, strict=True)
            columns = stack_runs([function(run)[ok] for run, ok in parts], per_run=per_run)
            made += self._append([per_axis(columns)[0]])
        return made

    def equations(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrices (3, k, k) of k columns and their right-hand sides (3, k)."""
        return self._table.equations(columns)

    def products_among(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return equations (3, …, …) and (3, …) that hold those of some columns in place."""
        return self._table.products_among(columns)

    def products(self, columns: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return normal matrices (3, c, c) and right-hand sides (3, c) of all columns, as views.

        They hold the products of `columns` with all others and those of each term, no others.
        """
        return self._table.products(columns)

    def size_of(self, term: ColumnGroup) -> FloatArray:
        """(p,) norm of the term's whitened columns before they were made one long."""
        return np.asarray(self._size[list(term.columns)])

    def solve(self, terms: Sequence[ColumnGroup]) -> tuple[float, int]:
        """Return the χ² the terms explain together and the rank they use."""
        own, common = self._split(terms)
        whole = self._with_target([*own, *common])
        full = np.einsum('aii->i', whole[:, len(own) : -1, len(own) : -1])
        left, ranks = zip(*(taken_out(axis, np.arange(len(own))) for axis in whole), strict=True)
        shared = np.sum(left, axis=0)[len(own) :, len(own) :]
        rest, rank = taken_out(shared, np.arange(len(common)), full)
        return -float(rest[-1, -1]), sum(ranks) + rank

    def reduced(self, known: Sequence[int], columns: Sequence[int]) -> FloatArray:
        """Return normal matrices (3, k, k) of columns with `known` taken out."""
        whole = self._with_target([*known, *columns])
        first = len(known)
        left = [taken_out(axis, np.arange(first))[0] for axis in whole]
        return np.stack(left)[:, first:-1, first:-1]

    def _with_target(self, columns: Sequence[int]) -> FloatArray:
        """Return (3, k + 1, k + 1) products of k columns and of the target, last, its own 0."""
        normal, right = self.equations(columns)
        size = len(columns)
        whole = np.zeros((3, size + 1, size + 1))
        whole[:, :size, :size] = normal
        whole[:, :size, size] = whole[:, size, :size] = right
        return whole

    def whitened_columns(self, terms: Sequence[ColumnGroup]) -> list[FloatArray]:
        """Return per axis the (rows, p) whitened columns, those shared last."""
        own, common = self._split(terms)
        return [self._table.columns[axis][[*own, *common]].T for axis in range(3)]

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
            if effect.needs and not shared:
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

    def _take_out_shared(self, columns: FloatArray) -> None:
        """Take columns (rows, 3, p) with coefficients that the axes share out of the target.

        Other columns cannot be made orthogonal to them axis by axis: who weighs these has to allow
        for those, too.
        """
        (group,) = self._append([columns])
        self.shared_base = replace(group, shared=True)
        normal, right = self.equations(group.columns)
        fitted, rank = pseudo_solve(normal.sum(axis=0), right.sum(axis=0)[:, None])
        place = slice(group.columns[0], group.columns[-1] + 1)
        self.target -= fitted[:, 0] @ self._table.columns[:, place]
        self._table.settle([place], self.target)
        size = self.size_of(group)
        self.log_density -= float(np.log(size[size > 0.0]).sum())
        self.base_rank += rank

    def _append(self, parts: Sequence[FloatArray]) -> list[ColumnGroup]:
        """Whiten, project and keep columns (rows, 3, p) of several parts."""
        places = self._table.append(parts)
        start, stop = places[0].start, places[-1].stop
        before, left = np.zeros((2, stop - start))
        for axis, columns in enumerate(self._table.columns):
            for first in range(start, stop, COLUMNS_AT_A_TIME):
                new = columns[first : min(first + COLUMNS_AT_A_TIME, stop)]
                here = slice(first - start, first - start + len(new))
                self.whitening.whiten_in_place(new, axis)
                before[here] += _power(new)
                new -= (new @ self.base[axis]) @ self.base[axis].T
                left[here] += _power(new)
        before, size = np.sqrt(before), np.sqrt(left)
        scale = np.where(size > LEAST_NEW_LENGTH * before, 1.0 / np.maximum(size, 1e-300), 0.0)
        self._size = np.concatenate([self._size, size])
        self._table.columns[:, start:stop] *= scale[:, None]
        self._table.settle(places, self.target)
        return [ColumnGroup(tuple(range(place.start, place.stop))) for place in places]


def _power(columns: FloatArray) -> FloatArray:
    """Return the sums of squares of columns (p, rows)."""
    return np.asarray(np.einsum('pn,pn->p', columns, columns))
