# SPDX-License-Identifier: Apache-2.0
"""A model that is rich enough to follow any repeatable effect: what it leaves is noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from scipy.interpolate import BSpline

from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.operators import follow, grow_and_melt, play
from thermal_comp.linear.columns import orthonormal

LAGS_S: FloatArray = np.array([60.0, 180.0, 540.0, 1620.0])
"""Time constants of its lagged temperatures [s]."""

BRANCH_LAG_S = 120.0
"""Lag above which the temperature counts as rising [s]."""

HALF_WIDTHS_K = (1.5, 4.0, 8.0, 16.0)
"""Half-widths of its plays [K]."""

ICE_TIMES_S = ((900.0, 400.0), (3600.0, 400.0), (900.0, 1600.0))
"""Growth and melt times of its ice [s]."""
ICE_TIMES_BY_DEGREES_S = ((2000.0, 1000.0), (100_000.0, 50_000.0))
"""Those of ice that grows and melts in proportion to the distance from 0 °C."""

LARGEST_COLUMN_SHARE = 0.4
"""Columns the model may have, as a share of the effective blocks."""


@dataclass(frozen=True)
class SaturatedModel:
    """Columns of temperature × branch, lags, channels and time, for each run and axis.

    They follow every effect of the catalogue to first order. A run of few effective blocks, to
    which so many columns would leave little, has powers of temperature and time, and a lag.
    """

    channels: tuple[str, ...] = ()
    """Logged channels whose effects it follows."""
    over_time: bool = True
    """Whether it follows what changes with time since power-on and from cycle to cycle."""
    time_scale: float = 1.0
    """Share of the usual times that its own are (`time_scale`)."""

    def __call__(self, run: PreparedRun) -> FloatArray:
        """Return an orthonormal basis (m, p) over the blocks of a run."""
        if not self.over_time:
            return joined_basis(self._repeatable(run))
        columns = [*self._repeatable(run), *_slow(run, self.time_scale)]
        if _too_many(columns, run):
            columns = _columns_of_few_blocks(run, self.time_scale)
        return joined_basis(columns)

    def follows_any_effect(self, run: PreparedRun) -> bool:
        """Tell whether a run has blocks enough for columns that follow every effect."""
        return not _too_many([*self._repeatable(run), *_slow(run, self.time_scale)], run)

    def _repeatable(self, run: PreparedRun) -> list[FloatArray]:
        own = (channel_columns(run, channel) for channel in self.channels)
        return [*_of_temperature(run, self.time_scale), *own]


def channel_columns(run: PreparedRun, channel: str) -> FloatArray:
    """Return the columns (m, k) of a channel, its mean where it is unknown; k = 0 without it."""
    if not run.block_conditions.has(channel):
        return np.zeros((len(run), 0))
    values = getattr(run.block_conditions, channel).reshape(len(run), -1)
    return np.where(np.isnan(values), np.nanmean(values, axis=0), values)


def _too_many(columns: Sequence[FloatArray], run: PreparedRun) -> bool:
    count = sum(part.shape[1] for part in columns)
    return bool(count > LARGEST_COLUMN_SHARE * _effective_blocks(run))


def joined_basis(columns: Sequence[FloatArray]) -> FloatArray:
    """Return an orthonormal basis of all columns (m, …) together."""
    return orthonormal(np.concatenate(columns, axis=1))


def _of_temperature(run: PreparedRun, scale: float) -> list[FloatArray]:
    """Return columns of temperature by branch, lags, plays and ice."""
    temperature = run.temperature
    time = run.time
    behind = follow(time, temperature, scale * BRANCH_LAG_S, held=True)[0]
    branch = np.sign(temperature - behind)
    spline = _spline(temperature)
    blocks = [run.level_columns, spline, spline * branch[:, None]]
    lagged = [follow(time, temperature, lag, held=True)[0] for lag in scale * LAGS_S]
    blocks += [(temperature - followed)[:, None] for followed in lagged]
    blocks += [play(temperature, width)[0][:, None] for width in HALF_WIDTHS_K]
    ice = [grow_and_melt(time, temperature, grow, melt)[0] for grow, melt in ICE_TIMES_S]
    ice += [
        grow_and_melt(time, temperature, *times, by_degrees=True)[0]
        for times in ICE_TIMES_BY_DEGREES_S
    ]
    blocks.append(np.stack(ice, axis=1))
    return blocks


def _effective_blocks(run: PreparedRun) -> float:
    """Return the effective number of blocks: a burst that is short beside its pauses counts one.

    A stretch of b blocks between pauses of g blocks counts b · min(1, b / g), at least one.
    """
    steps = np.diff(run.slot)
    ends = np.flatnonzero(steps > 1)
    if not len(ends):
        return float(len(run))
    lengths = np.diff(np.r_[-1, ends, len(steps)])
    pause = float(np.mean(steps[ends] - 1))
    return float(np.maximum(lengths * np.minimum(lengths / pause, 1.0), 1.0).sum())


def _columns_of_few_blocks(run: PreparedRun, scale: float) -> list[FloatArray]:
    """Return the columns of a run of few effective blocks."""
    temperature, time = run.temperature, run.time
    low, span = float(temperature.min()), max(float(np.ptp(temperature)), 1e-6)
    x, t = (temperature - low) / span, (time - time[0]) / max(float(np.ptp(time)), 1.0)
    lagged = x - follow(time, x, scale * LAGS_S[1], held=True)[0]
    return [np.stack([np.ones_like(x), x, x**2, x**3, t, t**2, lagged], axis=1)]


def _slow(run: PreparedRun, scale: float) -> list[FloatArray]:
    """Return columns of time since power-on and of cycles."""
    since = run.time - run.time[0]
    share = (since / max(since[-1], 1.0))[:, None]
    centred = (run.temperature - run.temperature.mean())[:, None]
    blocks = [np.exp(-since[:, None] / (scale * np.array([300.0, 1800.0])))]
    blocks += [share, centred * share, centred * share**2]
    if run.cycle is not None:
        levels = [run.cycle == number for number in np.unique(run.cycle)]
        blocks.append(np.stack(levels, axis=1).astype(float))
    return blocks


def _spline(temperature: FloatArray, pieces: int = 6) -> FloatArray:
    """Return (m, pieces + 3) cubic B-splines over the range of the temperature."""
    low, high = float(temperature.min()), float(temperature.max())
    if high - low < 0.5:
        return np.ones((len(temperature), 1))
    inner = np.linspace(low, high, pieces + 1)
    knots = np.concatenate([[low] * 3, inner, [high] * 3])
    return np.asarray(BSpline.design_matrix(temperature, knots, 3).toarray())
