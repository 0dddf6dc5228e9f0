# SPDX-License-Identifier: Apache-2.0
"""Products of columns summed over parts of runs: fits without a part, and the error on it.

`comparison.held_out` refits a model without each part and says what noise would leave; a search
asks for the error of thousands of forms, of which each here takes one solution of small sums.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.blocks import contiguous_parts
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import LEAST_HELD_OUT_PARTS
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect, columns_from
from thermal_comp.linear.columns import orthonormal, per_axis, project_out, stack_runs
from thermal_comp.linear.normal_equations import pseudo_solve
from thermal_comp.linear.whitening import RowWhitening
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.covariance import block_variances

LONG_PARTS = 4
"""Parts of a run without cycles that a term must lower the error on, too: between near neighbours
what is smooth in time passes for an effect of temperature."""


@dataclass(frozen=True, eq=False)
class PartSums:
    """Products of levels, columns and the measured values over k pieces: parts of runs.

    A piece is whitened by itself, so that no other piece knows anything of it.
    """

    white: FloatArray
    """(3, k, q, q) whitened; the measured values come last."""
    plain: FloatArray
    """(3, k, q, q) of rows in units of still ones, less what only the piece itself can tell."""
    rows: IntArray
    """(k,) blocks of each piece."""
    part: IntArray
    """(k,) held out together; 0 is never held out."""
    cycles: bool
    """Whether the parts are thermal cycles; else they follow each other in time."""
    run: IntArray
    """(k,)."""
    known: IntArray
    """Columns of every fit: levels of the runs, decays after gaps, the effects of the model."""
    places: Mapping[Effect, IntArray]
    """Columns of each further effect."""
    variance: FloatArray
    """(3,) of the noise of a still block [unit²]."""

    def parts(self) -> list[int]:
        """Return the parts that are held out in turn."""
        return sorted({int(p) for p in self.part if p > 0})

    def longer(self) -> PartSums:
        """Return the same sums over LONG_PARTS parts, or themselves if they have no more.

        Thermal cycles stay as they are: each meets all temperatures, far from the others in time.
        """
        most = int(self.part.max())
        if self.cycles or most <= LONG_PARTS:
            return self
        return replace(self, part=1 + (self.part - 1) * LONG_PARTS // most)

    def training(self, part: int) -> FloatArray:
        """(3, q, q) whitened sums over all pieces but those of one part; of all for part 0."""
        kept = (self.part != part) if part else np.ones(len(self.part), dtype=bool)
        total: FloatArray = self.white[:, kept].sum(axis=1)
        return total

    def held_out(self, part: int) -> NDArray[np.intp]:
        """Return the pieces of a part whose level the rest of the run tells."""
        told = {int(r) for r in self.run[self.part != part]}
        own = (self.part == part) & np.array([int(r) in told for r in self.run])
        return np.flatnonzero(own)

    def errors(
        self, part: int, columns: IntArray, penalty: FloatArray | None = None
    ) -> FloatArray:
        """(pieces of the part, 3) mean square of what a fit to the rest leaves [unit²].

        `penalty` (3, columns) is added to the diagonal of the normal equations.
        """
        sums, pieces = self.training(part), self.held_out(part)
        found = np.empty((len(pieces), 3))
        for axis in range(3):
            normal = sums[axis][np.ix_(columns, columns)]
            if penalty is not None:
                normal += np.diag(penalty[axis])
            answer = pseudo_solve(normal, sums[axis][columns, -1:])[0][:, 0]
            weights, place = np.append(-answer, 1.0), np.append(columns, sums.shape[1] - 1)
            blocks = self.plain[axis][pieces][:, place[:, None], place]
            found[:, axis] = np.einsum('i,kij,j->k', weights, blocks, weights)
        return np.maximum(found, 0.0) / self.rows[pieces, None]


def part_sums(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    known: Sequence[Effect],
    further: Sequence[Effect],
    noise: NoiseModel,
) -> PartSums:
    """Return the sums over the parts of the runs; `known` effects are in every fit.

    Fits are without the noise of the thermometer, their errors with it. Errors where the device
    was shaken count in the noise that is there.
    """
    groups, cycles = _parts_of(runs, sensor)
    effects = (*known, *further)
    measured = _Tables.of(runs, sensor, effects)
    smoothed = _Tables.of([run.smoothed for run in runs], sensor, effects)
    own = measured.own_of_runs(len(known))
    still = noise.variance_of_means(runs[0].period)
    white, plain, rows, part, number = [], [], [], [], []
    for r, run in enumerate(runs):
        valid = run.valid(sensor)
        for p in np.unique(groups[r][valid]).tolist():
            here = valid & (groups[r] == p)
            span = _span(runs, groups, p)
            fitted = smoothed.rows(r, here).transpose(1, 0, 2)
            whitened = RowWhitening.of_runs([run], [here], noise.weights).whitened(fitted)
            table = measured.rows(r, here, span)
            table *= np.sqrt(still / block_variances(noise, run)[here]).T[:, :, None]
            for axis in range(3) if len(own) else ():
                table[axis] = project_out(orthonormal(table[axis][:, own]), table[axis])
            white.append(whitened.transpose(0, 2, 1) @ whitened)
            plain.append(table.transpose(0, 2, 1) @ table)
            rows.append(int(here.sum()))
            part.append(p)
            number.append(r)
    return PartSums(
        white=np.stack(white, axis=1),
        plain=np.stack(plain, axis=1),
        rows=np.array(rows),
        part=np.array(part),
        cycles=cycles,
        run=np.array(number),
        known=np.arange(measured.starts[len(known)]),
        places={effect: measured.place(len(known) + k) for k, effect in enumerate(further)},
        variance=still,
    )


@dataclass(frozen=True, eq=False)
class _Tables:
    """Rows of the runs: their levels, decays after gaps, columns of effects, what was measured."""

    runs: Sequence[PreparedRun]
    sensor: Sensor
    effects: Sequence[Effect]
    columns: list[list[FloatArray]]
    """(m, 3, p) per effect and run."""
    decays: IntArray
    """(runs + 1,) first column of the decays after the gaps of each run, and the end of all."""
    starts: IntArray
    """(effects + 1,) first column of each effect, and the end of all."""

    @classmethod
    def of(cls, runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect]) -> _Tables:
        columns = [_columns(runs, sensor, effect) for effect in effects]
        decays = np.cumsum([len(runs), *(run.after_gaps.shape[1] for run in runs)])
        starts = np.cumsum([decays[-1], *(parts[0].shape[2] for parts in columns)])
        return cls(runs, sensor, effects, columns, decays, starts)

    def place(self, k: int) -> IntArray:
        """Return the columns of the k-th effect."""
        return np.arange(self.starts[k], self.starts[k + 1])

    def own_of_runs(self, known: int) -> IntArray:
        """Return the columns that only a run itself can tell: decays, known effects per run."""
        per_run = [self.place(k) for k in range(known) if self.effects[k].per_run]
        return np.concatenate([np.arange(self.decays[0], self.decays[-1]), *per_run])

    def rows(
        self, r: int, here: NDArray[np.bool_], span: tuple[float, float] | None = None
    ) -> FloatArray:
        """Return the (3, blocks, q) rows of some blocks of a run, what was measured last.

        `span`: temperatures [°C] beyond which effects that bend run on as a line.
        """
        run = self.runs[r]
        values = run.measured[self.sensor]
        found = np.zeros((3, int(here.sum()), int(self.starts[-1]) + 1))
        found[:, :, r] = 1.0
        found[:, :, self.decays[r] : self.decays[r + 1]] = run.after_gaps[here]
        found[:, :, -1] = (values[here] - np.nanmean(values, axis=0)).T
        for k, effect in enumerate(self.effects):
            columns = self.columns[k][r]
            if span is not None and effect.bends:
                columns = _straight(run, effect, self.sensor, span)
            found[:, :, self.starts[k] : self.starts[k + 1]] = columns[here].transpose(1, 0, 2)
        return found


def _parts_of(runs: Sequence[PreparedRun], sensor: Sensor) -> tuple[list[IntArray], bool]:
    """Return (m,) part of each block of each run, and whether any of them are cycles.

    They are its cycles, or contiguous blocks where those are few.
    """
    groups = [run.cv_group for run in runs]
    found = sum(
        len(np.unique(group[(group > 0) & run.valid(sensor)]))
        for run, group in zip(runs, groups, strict=True)
    )
    if found >= LEAST_HELD_OUT_PARTS:
        return groups, any(run.has_cycles for run in runs)
    return [contiguous_parts(len(run)) for run in runs], False


def _span(
    runs: Sequence[PreparedRun], groups: Sequence[IntArray], part: int
) -> tuple[float, float]:
    """Return the temperatures of the blocks outside a part [°C]."""
    seen = np.concatenate(
        [run.temperature[g != part] for run, g in zip(runs, groups, strict=True)]
    )
    return (float(seen.min()), float(seen.max())) if len(seen) else (-np.inf, np.inf)


def _straight(
    run: PreparedRun, effect: Effect, sensor: Sensor, span: tuple[float, float]
) -> FloatArray:
    """Return the (m, 3, p) columns as a model has them that was fitted within a span [°C]."""
    columns, _ = columns_from(effect, run.conditions.of(sensor), span)
    return per_axis(run.block_mean(columns))[0]


def _columns(runs: Sequence[PreparedRun], sensor: Sensor, effect: Effect) -> list[FloatArray]:
    """Return the (m, 3, p) columns of an effect in each run; per run, each has its own."""
    parts = [per_axis(run.columns(effect, sensor))[0] for run in runs]
    edges = np.cumsum([len(run) for run in runs])[:-1]
    return np.split(stack_runs(parts, per_run=effect.per_run), edges)
