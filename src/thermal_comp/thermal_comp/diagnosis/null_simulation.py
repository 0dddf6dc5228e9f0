# SPDX-License-Identifier: Apache-2.0
"""Evidence that effects reach in campaigns that hold noise alone, many at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.candidates import Family, campaign_of, candidates
from thermal_comp.diagnosis.spectral_lines import spectral_lines
from thermal_comp.effects.effect import Candidate, Effect
from thermal_comp.linear.candidate_design import RANK_TOLERANCE, CandidateDesign, ColumnSource

ABSORBED_POWER_SHARE = 1e-10
"""A column of which less than this share of its power is left says nothing beside the base."""

Draw = Sequence[FloatArray]
"""(m, 3) values per run."""


def reached_in_draws(
    design: CandidateDesign, families: Sequence[Family], draws: Sequence[Draw]
) -> dict[str, FloatArray]:
    """Return the evidence (draws,) of each family's best form under the design's noise."""
    coupled = [f for f in families if any(t.shared for t in f.forms[0].terms)]
    rights, single = [], []
    for draw in draws:
        design.retarget(draw)
        rights.append(design.right.copy())
        single.append([max(_evidence(design, f, k) for k in range(len(f.forms))) for f in coupled])
    best = np.array(single)
    reached = {family.name: best[:, k] for k, family in enumerate(coupled)}
    bic_penalty = float(np.log(design.rows))
    stacked = np.stack(rights)
    for family in families:
        if family.name not in reached:
            index = [[c for term in form.terms for c in term.columns] for form in family.forms]
            free = [form.free for form in family.forms]
            reached[family.name] = best_evidence(design.normal, stacked, index, free, bic_penalty)
    return reached


def _evidence(design: CandidateDesign, family: Family, k: int) -> float:
    form = family.forms[k]
    delta_chi2, rank = design.solve(form.terms)
    return delta_chi2 - (rank + form.free) * float(np.log(design.rows)) if rank else -np.inf


def best_evidence(
    normal: FloatArray,
    rights: FloatArray,
    index: Sequence[Sequence[int]],
    free: Sequence[int],
    bic_penalty: float,
) -> FloatArray:
    """Return the evidence (n,) of the best of several forms, for right-hand sides (n, 3, w).

    `normal` (3, w, w) per axis; a form is the columns `index` of each axis, none shared, with
    `free` shape parameters searched. Undetermined directions explain nothing and cost nothing.
    """
    best = np.full(len(rights), -np.inf)
    for count in {len(some) for some in index}:
        which = [k for k, some in enumerate(index) if len(some) == count]
        place = np.array([index[k] for k in which])
        blocks = normal[:, place[:, :, None], place[:, None, :]]
        size = np.sqrt(np.maximum(np.einsum('afkk->afk', blocks), 0.0))
        inverse = np.where(size > 1e-9, 1.0 / np.maximum(size, 1e-9), 0.0)
        values, vectors = np.linalg.eigh(blocks * inverse[..., None] * inverse[:, :, None, :])
        kept = values > RANK_TOLERANCE
        scaled = rights[:, :, place] * inverse
        turned = np.einsum('afkj,nafk->nafj', vectors, scaled)
        weight = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
        delta_chi2 = np.einsum('nafj,afj->nf', turned**2, weight)
        rank = kept.sum(axis=(0, 2))
        cost = (rank + np.array([free[k] for k in which])) * bic_penalty
        evidence = np.where(rank > 0, delta_chi2 - cost, -np.inf)
        best = np.maximum(best, evidence.max(axis=1))
    return best


@dataclass(frozen=True, eq=False)
class SlowEffects:
    """Effects of time alone, scored on draws whose noise is fitted anew to each of them."""

    source: ColumnSource
    catalogue: Mapping[str, type[Effect]]
    known: dict[Effect, list[FloatArray]]
    """Columns per run of the forms that do not depend on a draw."""

    def reached(self, design: CandidateDesign) -> dict[str, float]:
        """Return the evidence of each family's best form in the draw the design holds."""
        campaign = replace(campaign_of(design), spectral_lines=partial(_lines, design))
        tried = candidates(design, self.catalogue, campaign)
        effects = list(
            dict.fromkeys(p for some in tried.values() for c in some for p in c.effect.parts())
        )
        table = _Table.of([self._columns(design, effect) for effect in effects], effects)
        normal, right = table.equations(design)
        bic_penalty = float(np.log(design.rows))
        return {
            name: float(
                best_evidence(
                    normal,
                    right[None],
                    [table.index(candidate) for candidate in some],
                    [candidate.effect.free_shapes for candidate in some],
                    bic_penalty,
                )[0]
            )
            for name, some in tried.items()
        }

    def _columns(self, design: CandidateDesign, effect: Effect) -> list[FloatArray]:
        columns = self.known.get(effect)
        if columns is None:
            columns = [run.columns(effect, design.sensor) for run in self.source.runs]
        return columns


def _lines(design: CandidateDesign) -> list[float]:
    """Return the most prominent lines of a draw, which has no finer rows than its blocks."""
    runs, at = design.source.runs, 0
    coarse: list[PreparedRun] = []
    for run, ok in zip(runs, design.valid, strict=True):
        values = np.full((len(run), 3), np.nan)
        values[ok] = design.target[:, at : at + int(ok.sum())].T
        at += int(ok.sum())
        coarse.append(
            replace(run, conditions=run.block_conditions, fine_measured={design.sensor: values})
        )
    return spectral_lines(coarse, design.sensor)


@dataclass(frozen=True, eq=False)
class _Table:
    """Columns of several effects and which unknowns they belong to."""

    columns: list[FloatArray]
    """(m, p) per run, all effects beside each other."""
    unknown: list[IntArray]
    """(p,) per run: the unknown of each column."""
    first: dict[Effect, tuple[int, int]]
    """First unknown of an effect and its columns per run."""
    width: int

    @classmethod
    def of(cls, columns: Sequence[list[FloatArray]], effects: Sequence[Effect]) -> _Table:
        """Stack the columns; effects per run get unknowns for every run."""
        runs = len(columns[0])
        unknown: list[list[int]] = [[] for _ in range(runs)]
        first, width = {}, 0
        for effect, parts in zip(effects, columns, strict=True):
            count = parts[0].shape[1]
            first[effect] = (width, count)
            for r in range(runs):
                start = width + r * count * effect.per_run
                unknown[r] += range(start, start + count)
            width += count * (runs if effect.per_run else 1)
        stacked = [np.concatenate([parts[r] for parts in columns], axis=1) for r in range(runs)]
        return cls(stacked, [np.array(u) for u in unknown], first, width)

    def index(self, candidate: Candidate) -> list[int]:
        """Return the unknowns of a form."""
        found = []
        for part in candidate.effect.parts():
            start, count = self.first[part]
            runs = len(self.columns) if part.per_run else 1
            wanted = range(runs) if candidate.run is None else [candidate.run]
            found += [start + r * count + k for r in wanted for k in range(count)]
        return found

    def equations(self, design: CandidateDesign) -> tuple[FloatArray, FloatArray]:
        """Return normal matrices (3, w, w) and right-hand sides (3, w), the base taken out."""
        normal, right = np.zeros((3, self.width, self.width)), np.zeros((3, self.width))
        for axis in range(3):
            cross = np.zeros((design.base[axis].shape[1], self.width))
            for run, (columns, unknown) in enumerate(zip(self.columns, self.unknown, strict=True)):
                white, rows = design.whitened_in_run(columns, run, axis)
                normal[axis][np.ix_(unknown, unknown)] += white.T @ white
                cross[:, unknown] += design.base[axis][rows].T @ white
                right[axis, unknown] += white.T @ design.target[axis, rows]
            power = np.diag(normal[axis]).copy()
            normal[axis] -= cross.T @ cross
            absorbed = np.diag(normal[axis]) <= ABSORBED_POWER_SHARE * power
            normal[axis][absorbed] = normal[axis][:, absorbed] = right[axis, absorbed] = 0.0
        return normal, right
