# SPDX-License-Identifier: Apache-2.0
"""Evidence that effects reach in campaigns of noise alone, and thresholds calibrated by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.diagnosis.candidates import Family, Plan, families, plans
from thermal_comp.diagnosis.search import WITHOUT_CYCLE_VETO
from thermal_comp.diagnosis.spectral_lines import spectral_lines
from thermal_comp.diagnosis.thresholds import EVERYWHERE, shipped_thresholds, threshold_of
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import usable_sensors
from thermal_comp.linear.candidate_design import RANK_TOLERANCE, ColumnBank, ColumnSource
from thermal_comp.linear.whitening import apply_gains, innovation_gains
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise_to_values
from thermal_comp.noise.of_runs import determined_noise
from thermal_comp.noise.process import draw_noise

LINE = 'mains_alias'
"""Its forms depend on the spectrum of a draw."""

ABSORBED = 1e-10
"""A column of which less than this share of its power is left says nothing beside the base."""

Draw = Sequence[FloatArray]
"""(m, 3) values per run."""


def reached_in_draws(
    bank: ColumnBank, families: Sequence[Family], draws: Sequence[Draw]
) -> dict[str, FloatArray]:
    """Return the evidence (draws,) of each family's best form; the bank's noise is the draws'."""
    coupled = [f for f in families if any(t.shared for t in f.forms[0].terms)]
    rights, single = [], []
    for draw in draws:
        bank.retarget(draw)
        rights.append(bank.right.copy())
        single.append([max(_evidence(bank, f, k) for k in range(len(f.forms))) for f in coupled])
    best = np.array(single)
    reached = {family.name: best[:, k] for k, family in enumerate(coupled)}
    price = float(np.log(bank.rows))
    stacked = np.stack(rights)
    for family in families:
        if family.name not in reached:
            index = [[c for term in form.terms for c in term.columns] for form in family.forms]
            free = [form.free for form in family.forms]
            reached[family.name] = best_evidence(bank.normal, stacked, index, free, price)
    return reached


def _evidence(bank: ColumnBank, family: Family, k: int) -> float:
    form = family.forms[k]
    gain, rank = bank.solve(form.terms)
    return gain - (rank + form.free) * float(np.log(bank.rows)) if rank else -np.inf


def best_evidence(
    normal: FloatArray,
    rights: FloatArray,
    index: Sequence[Sequence[int]],
    free: Sequence[int],
    price: float,
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
        gain = np.einsum('nafj,afj->nf', turned**2, weight)
        rank = kept.sum(axis=(0, 2))
        cost = (rank + np.array([free[k] for k in which])) * price
        evidence = np.where(rank > 0, gain - cost, -np.inf)
        best = np.maximum(best, evidence.max(axis=1))
    return best


@dataclass(frozen=True, eq=False)
class SlowEffects:
    """Effects of time alone, rated on draws whose noise is fitted anew to each of them."""

    source: ColumnSource
    catalogue: Mapping[str, type[Effect]]
    known: dict[Effect, list[FloatArray]]
    """Columns per run of the forms that do not depend on a draw."""

    def reached(self, bank: ColumnBank) -> dict[str, float]:
        """Return the evidence of each family's best form in the draw that is the bank's target."""
        planned = plans(bank, {n: e for n, e in self.catalogue.items() if n != LINE})
        if LINE in self.catalogue:
            lines = [self.catalogue[LINE](f) for f in _lines(bank)]  # type: ignore[call-arg]
            planned[LINE] = [Plan(line, (line,), 1) for line in lines]
        effects = list(
            dict.fromkeys(p for some in planned.values() for x in some for p in x.parts)
        )
        table = _Table.of([self._columns(bank, effect) for effect in effects], effects)
        normal, right = table.equations(bank)
        price = float(np.log(bank.rows))
        return {
            name: float(
                best_evidence(
                    normal,
                    right[None],
                    [table.index(plan) for plan in some],
                    [plan.free for plan in some],
                    price,
                )[0]
            )
            for name, some in planned.items()
            if some
        }

    def _columns(self, bank: ColumnBank, effect: Effect) -> list[FloatArray]:
        columns = self.known.get(effect)
        if columns is None:
            columns = [run.columns(effect, bank.sensor) for run in self.source.runs]
        return columns


def _lines(bank: ColumnBank) -> list[float]:
    """Return the most prominent lines of a draw, which has no finer rows than its blocks."""
    runs, at = bank.source.runs, 0
    coarse: list[PreparedRun] = []
    for run, ok in zip(runs, bank.valid, strict=True):
        values = np.full((len(run), 3), np.nan)
        values[ok] = bank.target[:, at : at + int(ok.sum())].T
        at += int(ok.sum())
        coarse.append(
            replace(run, conditions=run.block_conditions, fine_measured={bank.sensor: values})
        )
    return spectral_lines(coarse, bank.sensor)


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

    def index(self, plan: Plan) -> list[int]:
        """Return the unknowns of a form."""
        found = []
        for part in plan.parts:
            start, count = self.first[part]
            runs = len(self.columns) if part.per_run else 1
            wanted = range(runs) if plan.run is None else [plan.run]
            found += [start + r * count + k for r in wanted for k in range(count)]
        return found

    def equations(self, bank: ColumnBank) -> tuple[FloatArray, FloatArray]:
        """Return normal matrices (3, w, w) and right-hand sides (3, w), the base taken out."""
        normal, right = np.zeros((3, self.width, self.width)), np.zeros((3, self.width))
        for axis in range(3):
            cross = np.zeros((bank.base[axis].shape[1], self.width))
            at = 0
            for run, ok, columns, unknown in zip(
                bank.source.runs, bank.valid, self.columns, self.unknown, strict=True
            ):
                gains = innovation_gains(run.slot[ok], bank.noise, axis, run.period)
                white = apply_gains(columns[ok], gains)
                rows = slice(at, at + len(white))
                at += len(white)
                normal[axis][np.ix_(unknown, unknown)] += white.T @ white
                cross[:, unknown] += bank.base[axis][rows].T @ white
                right[axis, unknown] += white.T @ bank.target[axis, rows]
            power = np.diag(normal[axis]).copy()
            normal[axis] -= cross.T @ cross
            absorbed = np.diag(normal[axis]) <= ABSORBED * power
            normal[axis][absorbed] = normal[axis][:, absorbed] = right[axis, absorbed] = 0.0
        return normal, right


SLOW = (*WITHOUT_CYCLE_VETO, 'bias_drift')
"""Effects whose evidence depends on how well slow noise is known: it is fitted to every draw."""
MARGIN = 5.0
QUANTILE = 0.995
TAIL = 0.9
"""Quantile from which on the tail is taken as exponential."""

Listed = Mapping[Sensor, tuple[Effect, ...]]


def calibrated_thresholds(
    runs: Sequence[PreparedRun],
    base: Listed,
    catalogue: Mapping[str, type[Effect]],
    draws: int,
    seed: int = 0,
) -> dict[str, float]:
    """Return the evidence each effect needs: quantile over draws of noise alone, plus a margin.

    The draws have the noise fitted to the recordings; thresholds never fall below the shipped.
    """
    noise, _ = determined_noise(runs, {s: base[s] for s in usable_sensors(runs)[0]})
    reached = reached_without_effect(runs, noise, base, catalogue, draws, seed)
    raised = {
        name: max(threshold_of(name), EVERYWHERE, tail_quantile(found, QUANTILE) + MARGIN)
        for name, found in reached.items()
    }
    return {**shipped_thresholds(), **raised}


def reached_without_effect(
    runs: Sequence[PreparedRun],
    noise: Mapping[Sensor, NoiseModel],
    base: Listed,
    catalogue: Mapping[str, type[Effect]],
    draws: int,
    seed: int = 0,
) -> dict[str, FloatArray]:
    """Return the evidence each effect reaches in draws of the noise, for all sensors together.

    0 stands for a draw in which there was nothing to rate.
    """
    source = ColumnSource(runs)
    found: dict[str, list[FloatArray]] = {}
    with ThreadPoolExecutor() as pool:
        for number, (sensor, model) in enumerate(noise.items()):
            rng = np.random.default_rng([seed, number])
            drawn = [_draw(runs, sensor, model, rng) for _ in range(draws)]
            bank = ColumnBank(source, sensor, model, base[sensor])
            steady = {n: e for n, e in catalogue.items() if n not in SLOW}
            slow = {n: e for n, e in catalogue.items() if n in SLOW}
            rated = SlowEffects(source, slow, _fixed_columns(bank, slow))
            tasks = [pool.submit(_reached_once, rated, bank, base[sensor], d) for d in drawn]
            for name, values in reached_in_draws(bank, families(bank, steady), drawn).items():
                found.setdefault(name, []).append(values)
            once = [task.result() for task in tasks]
            for name in {n for some in once for n in some}:
                values = np.array([some.get(name, 0.0) for some in once])
                found.setdefault(name, []).append(values)
    return {name: np.concatenate(values) for name, values in found.items()}


def tail_quantile(values: FloatArray, share: float) -> float:
    """Return the quantile of a sample, at least that of an exponential fitted to its tail.

    Beyond the quantile TAIL the excess has mean s: q(p) = q(TAIL) + s · ln((1 − TAIL) / (1 − p)).
    """
    start = float(np.quantile(values, TAIL))
    beyond = values[values > start]
    scale = float((beyond - start).mean()) if len(beyond) else 0.0
    extrapolated = start + scale * float(np.log((1.0 - TAIL) / (1.0 - share)))
    return max(extrapolated, float(np.quantile(values, share)))


def _draw(
    runs: Sequence[PreparedRun], sensor: Sensor, noise: NoiseModel, rng: np.random.Generator
) -> Draw:
    """Return one draw with the gaps of what was measured."""
    drawn = [draw_noise(noise, run.slot, run.period, rng) for run in runs]
    for values, run in zip(drawn, runs, strict=True):
        values[~np.isfinite(run.measured[sensor]).all(axis=1)] = np.nan
    return drawn


def _fixed_columns(
    bank: ColumnBank, catalogue: Mapping[str, type[Effect]]
) -> dict[Effect, list[FloatArray]]:
    planned = plans(bank, {n: e for n, e in catalogue.items() if n != LINE})
    effects = {part for some in planned.values() for plan in some for part in plan.parts}
    return {e: [run.columns(e, bank.sensor) for run in bank.source.runs] for e in effects}


def _reached_once(
    rated: SlowEffects, bank: ColumnBank, base: Sequence[Effect], drawn: Draw
) -> dict[str, float]:
    noise = fit_noise_to_values(bank.source.runs, drawn)
    return rated.reached(ColumnBank(bank.source, bank.sensor, noise, base, drawn))
