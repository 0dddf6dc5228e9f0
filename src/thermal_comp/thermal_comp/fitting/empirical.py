# SPDX-License-Identifier: Apache-2.0
"""The empirical term on the axes that need it, its prior widths by the marginal likelihood."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import falls, falls_enough, may_fall
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.empirical_term import (
    COLUMN_GROUPS,
    GROUP_COUNT,
    PLAIN_GROUPS,
    Empirical,
)
from thermal_comp.fitting.part_sums import PartSums, part_sums
from thermal_comp.linear.design import prior_precision
from thermal_comp.linear.normal_equations import taken_out
from thermal_comp.model.values import NoiseModel

WIDTH_LEVELS = (0.0, 1.0, 6.7, 45.0, 300.0)
"""Rms that a group of columns may have, in standard deviations of a whitened row."""
ROUNDING = 1e-12
"""Share of a column's power that counts as noise of its products."""
GROUP_PROBABILITY = 0.3
"""Probability that an axis needs a group at all."""


def empirical_form(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    beside: Sequence[Effect],
    noise: NoiseModel,
) -> Empirical | None:
    """Return the empirical term for the axes whose held-out error it lowers; None without any.

    Each group of columns of each axis is absent or has one of WIDTH_LEVELS, whichever is likeliest
    without the part that is held out. The error on longer parts must fall, too. The plain groups
    are tried alone and with all others: what leaves least is taken.
    """
    low = min(float(run.temperature.min()) for run in runs)
    high = max(float(run.temperature.max()) for run in runs)
    form = Empirical(0.5 * (low + high), max(0.5 * (high - low), 1.0))
    sums = part_sums(runs, sensor, beside, (form,), noise)
    own = sums.places[form]
    before = _errors(sums, own, {})
    if not any(may_fall(before[:, axis], sums.variance[axis]) for axis in range(3)):
        return None
    least, chosen = before.sum(axis=0), np.zeros((GROUP_COUNT, 3))
    for count in (PLAIN_GROUPS, GROUP_COUNT):
        after = _errors(sums, own, _widths_without(sums, own, count))
        lower = np.array([falls(before[:, k], after[:, k], sums.variance[k]) for k in range(3)])
        longer = sums.longer()
        if lower.any() and longer is not sums:
            lower &= _fall_on_longer(longer, own, count)
        lower &= after.sum(axis=0) < least
        if lower.any():
            least = np.where(lower, after.sum(axis=0), least)
            chosen = np.where(lower, _likeliest_widths(sums, 0, own, count), chosen)
    if not chosen.any():
        return None
    return Empirical(form.middle, form.half_range, tuple(chosen.ravel().tolist()))


def _widths_without(sums: PartSums, own: IntArray, count: int) -> Mapping[int, FloatArray]:
    """Return the likeliest widths of the first groups by the part that is held out."""
    return {part: _likeliest_widths(sums, part, own, count) for part in sums.parts()}


def _fall_on_longer(longer: PartSums, own: IntArray, count: int) -> NDArray[np.bool_]:
    """Return (3,) whether the error of each axis falls by enough to matter on longer parts."""
    before = _errors(longer, own, {}).sum(axis=0)
    after = _errors(longer, own, _widths_without(longer, own, count)).sum(axis=0)
    return np.array([falls_enough(*pair) for pair in zip(before, after, strict=True)])


def _errors(sums: PartSums, own: IntArray, widths: Mapping[int, FloatArray]) -> FloatArray:
    """Return (k, 3) mean squares on held-out pieces, without the term where it has no widths."""
    left = []
    for part in sums.parts():
        columns, penalty = sums.known, np.zeros((3, len(sums.known)))
        if part in widths:
            prior = prior_precision(widths[part][COLUMN_GROUPS])
            columns = np.concatenate([columns, own])
            penalty = np.concatenate([penalty, prior.T], axis=1)
        left.append(sums.errors(part, columns, penalty))
    return np.concatenate(left)


def _likeliest_widths(sums: PartSums, part: int, own: IntArray, count: int) -> FloatArray:
    """Return (g, 3) likeliest prior deviations by group and axis, from all parts but one.

    Those of the first `count` groups; the others are absent.
    """
    training, rows = sums.training(part), int(sums.rows[(sums.part != part) | (part == 0)].sum())
    found = np.zeros((GROUP_COUNT, 3))
    for axis in range(3):
        left = taken_out(training[axis], sums.known)[0]
        # A column that those before it explain leaves but rounding, which is no direction.
        rounding = ROUNDING * np.diag(training[axis])[own]
        left[own, own] += rounding
        power, least = (
            np.array([column[g == COLUMN_GROUPS].sum() for g in range(GROUP_COUNT)])
            for column in (np.diag(left)[own], 10.0 * rounding)
        )
        # Nor is a group that nothing is left of, or that never moved.
        unit = np.sqrt(rows / np.where(power > least, power, np.inf))
        everywhere = [_climbed(left, own, unit, rows, (start,) * count) for start in (0, 2)]
        levels = max(everywhere, key=lambda found: found[1])[0]
        found[:count, axis] = np.array([WIDTH_LEVELS[k] for k in levels]) * unit[:count]
    return found


def _climbed(
    left: FloatArray, own: IntArray, unit: FloatArray, rows: int, best: tuple[int, ...]
) -> tuple[tuple[int, ...], float]:
    """Return levels and their likelihood, from a start until no single change is likelier."""
    value = _log_likelihood(left, own, unit, rows, best)
    while True:
        tried = [(n, _log_likelihood(left, own, unit, rows, n)) for n in _neighbours(best)]
        further = max(tried, key=lambda found: found[1])
        if further[1] <= value:
            return best, value
        best, value = further


def _neighbours(levels: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Yield all levels that differ from these in one group."""
    for group in range(len(levels)):
        for level in range(len(WIDTH_LEVELS)):
            if level != levels[group]:
                yield (*levels[:group], level, *levels[group + 1 :])


def _log_likelihood(
    left: FloatArray, own: IntArray, unit: FloatArray, rows: int, levels: tuple[int, ...]
) -> float:
    """Return ln of the marginal likelihood and the prior of the levels; noise is integrated."""
    absent = (0,) * (GROUP_COUNT - len(levels))
    scale = (np.array([WIDTH_LEVELS[k] for k in (*levels, *absent)]) * unit)[COLUMN_GROUPS]
    on = scale > 0.0
    value = sum(
        np.log(GROUP_PROBABILITY / (len(WIDTH_LEVELS) - 1) if k else 1.0 - GROUP_PROBABILITY)
        for k in levels
    )
    energy = float(left[-1, -1])
    if on.any():
        place, s = own[on], scale[on]
        root = np.linalg.cholesky(np.eye(len(s)) + s[:, None] * left[np.ix_(place, place)] * s)
        half = np.linalg.solve(root, s * left[place, -1])
        energy -= float(half @ half)
        value -= float(np.log(np.diag(root)).sum())
    return float(value - 0.5 * rows * np.log(max(energy, 1e-300)))
