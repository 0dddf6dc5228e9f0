# SPDX-License-Identifier: Apache-2.0
"""Stretches at rest in a recording that moves, found by the noise of its own sensors.

A window rests where accelerometer and gyroscope scatter no more than their noise does (Skog et
al., IEEE Trans. Biomed. Eng. 57(11), 2010, zero-velocity detection by both variances). The noise
is that of the quietest seconds of the recording; where even these shake, nothing rests. Windows
are joined to a stretch while neither mean changes by more than noise: a device that was put down
elsewhere is another run. A turn at a constant rate about the vertical has no larger variance; it
is left out where its rate is not that of the other stretches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, FloatArray, ImuRecording, IntArray
from numpy.typing import NDArray

from thermal_comp.data.binning import bin_means, bin_variances

LEAST_WINDOW_S = 1.0
"""Least length of a window [s]."""
LEAST_SAMPLES = 8
"""Least number of samples in it: it is longer where samples are slow."""
QUIET_WINDOWS = 9
"""Windows in a row whose median scatter, where it is least, is the noise."""
LARGEST_SCATTER_RATIO = 1.4
"""Largest scatter of a window at rest, over that noise, apart from chance."""
CHANCE_SIGMA = 5.0
"""Chance that is allowed beside, in standard deviations of the scatter of a window's samples."""
LARGEST_CHANGE_RATIO = 6.0
"""Largest change of a mean from window to window at rest, over the usual one."""
LARGEST_REST_NOISE = {'gyroscope': 0.02, 'accelerometer': 0.2}
"""Noise above which a recording shakes throughout [rad/s, m/s²]."""
LEAST_MEAN_CHANGE = {'gyroscope': 5e-4, 'accelerometer': 5e-3}
"""Change of a mean that is allowed anyway [rad/s, m/s²]: far below the slowest motion by hand."""
GRAVITY_TOLERANCE = 0.2
"""Largest distance of the specific force at rest from gravity, as a share of it."""
LARGEST_RATE_DIFFERENCE = 0.02
"""Largest difference of the mean rates of two stretches, unless one is of a turn [rad/s]."""
LEAST_REST_S = 20.0
"""Shortest stretch that is taken as a run [s]."""


@dataclass(frozen=True, eq=False)
class Rest:
    """Where a recording rests."""

    stretches: tuple[slice, ...]
    """Rows of each stretch."""
    windows: NDArray[np.bool_]
    """(m,) whether each window rests, however short the stretch."""
    edges: IntArray
    """(m + 1,) first row of each window, and the first one after the last."""
    noise: dict[str, float]
    """Root mean square over axes of the scatter of a sample at rest [rad/s, m/s²]."""
    note: str
    """Why nothing rests, or how many stretches turned steadily; '' for neither."""


def find_rest(recording: ImuRecording, *, least_s: float = LEAST_REST_S) -> Rest:
    """Return the stretches of at least `least_s` seconds in which the device rests."""
    edges = _window_edges(recording)
    values = {
        'gyroscope': recording.angular_velocity,
        'accelerometer': recording.linear_acceleration,
    }
    m = max(len(edges) - 1, 0)
    if m < QUIET_WINDOWS:
        return _no_rest(edges, {}, 'it is shorter than a stretch at rest')
    resting, joined = np.ones(m, bool), np.ones(m - 1, bool)
    noise, means = {}, {}
    for sensor, columns in values.items():
        means[sensor] = bin_means(columns, edges)[0]
        variance = bin_variances(columns, edges, means[sensor]).mean(axis=1)
        scatter = np.sqrt(np.where(np.isfinite(variance), variance, np.inf))
        noise[sensor] = _noise_of(scatter, columns)
        if not np.isfinite(noise[sensor]):
            why = f'no {QUIET_WINDOWS} windows in a row have a finite {sensor} value'
            return _no_rest(edges, {}, why)
        if noise[sensor] > LARGEST_REST_NOISE[sensor]:
            why = f'its quietest seconds shake by {noise[sensor]:.2g} at the {sensor}'
            return _no_rest(edges, noise, why)
        chance = CHANCE_SIGMA / np.sqrt(6.0 * np.maximum(np.diff(edges) - 1, 1))
        resting &= scatter <= LARGEST_SCATTER_RATIO * noise[sensor] * (1.0 + chance)
        joined &= _alike(means[sensor], resting, LEAST_MEAN_CHANGE[sensor])
    norm = np.linalg.norm(means['accelerometer'], axis=1)
    resting &= np.abs(norm / STANDARD_GRAVITY - 1.0) < GRAVITY_TOLERANCE
    joined &= np.diff(recording.stamp[edges[:-1]]) < 2 * np.median(
        np.diff(recording.stamp[edges[:-1]])
    )
    found = _stretches(resting, joined, recording, edges, least_s)
    found, note = _without_turns(found, recording)
    return Rest(stretches=tuple(found), windows=resting, edges=edges, noise=noise, note=note)


def _no_rest(edges: IntArray, noise: dict[str, float], why: str) -> Rest:
    """Return that nothing rests, and why."""
    windows = np.zeros(max(len(edges) - 1, 0), bool)
    return Rest(stretches=(), windows=windows, edges=edges, noise=noise, note=why)


def _window_edges(recording: ImuRecording) -> IntArray:
    """Return the first row of each window that has enough samples, and the end of the last."""
    n = len(recording)
    if n < LEAST_SAMPLES:
        return np.zeros(0, np.int64)
    step = max(float(np.median(np.diff(recording.stamp))), 1.0)
    length = max(round(LEAST_WINDOW_S * 1e9), round(LEAST_SAMPLES * step))
    place = (recording.stamp - recording.stamp[0]) // length
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    return np.append(starts, n).astype(np.int64)


def _noise_of(scatter: FloatArray, columns: FloatArray) -> float:
    """Return the scatter of the quietest windows in a row; no less than rounding makes."""
    usual = np.median(np.lib.stride_tricks.sliding_window_view(scatter, QUIET_WINDOWS), axis=1)
    steps = np.abs(np.diff(columns[: 1 << 16], axis=0))
    least = float(steps[steps > 0.0].min(initial=np.inf))
    rounding = least / np.sqrt(12.0) if np.isfinite(least) else 0.0
    return max(float(usual.min()), rounding)


def _alike(means: FloatArray, resting: NDArray[np.bool_], least: float) -> NDArray[np.bool_]:
    """Return whether the mean of each window is that of the one before, within noise."""
    change = np.linalg.norm(np.diff(means, axis=0), axis=1)
    both = resting[1:] & resting[:-1]
    usual = float(np.median(change[both])) if both.any() else 0.0
    return np.asarray(change <= max(LARGEST_CHANGE_RATIO * usual, least))


def _stretches(
    resting: NDArray[np.bool_],
    joined: NDArray[np.bool_],
    recording: ImuRecording,
    edges: IntArray,
    least_s: float,
) -> list[slice]:
    """Return the rows of stretches long enough, without a window at either end."""
    found = []
    cuts = np.flatnonzero(~(joined & resting[1:] & resting[:-1])) + 1
    bounds = [0, *cuts.tolist(), len(resting)]
    for first, after in pairwise(bounds):
        # The device is put down in the first window and lifted in the last.
        inner, end = first + 1, after - 1
        if not resting[first] or end <= inner:
            continue
        rows = slice(int(edges[inner]), int(edges[end]))
        if (recording.stamp[rows.stop - 1] - recording.stamp[rows.start]) * 1e-9 >= least_s:
            found.append(rows)
    return found


def _without_turns(found: Sequence[slice], recording: ImuRecording) -> tuple[list[slice], str]:
    """Return the stretches whose mean rate is that of the most time at rest."""
    if not found:
        return [], 'it never rests for long enough'
    rates = np.array([np.nanmean(recording.angular_velocity[rows], axis=0) for rows in found])
    length = np.array([rows.stop - rows.start for rows in found])
    near = np.linalg.norm(rates[:, None] - rates[None], axis=2) < LARGEST_RATE_DIFFERENCE
    kept = near[int(np.argmax(near @ length))]
    turning = int((~kept).sum())
    note = f'{turning} stretches at a steady turn are left out' if turning else ''
    return [rows for rows, keep in zip(found, kept.tolist(), strict=True) if keep], note
