# SPDX-License-Identifier: Apache-2.0
"""Slopes against die temperature, cycle by cycle: the replicates of the paper's claims.

The model itself is fitted by thermal_comp; here each cycle's slope is one observation, so that
repeatability, orientation and device can be compared with tests that assume nothing about noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording
from numpy.typing import NDArray
from scipy.special import fdtrc

BLOCKS_WITHOUT_CYCLES = 5
"""Number of contiguous blocks in place of cycles where a recording has none."""
LEAST_SPAN_K = 5.0
"""Temperature span [K] that a block needs for a slope."""


@dataclass(frozen=True, eq=False)
class OrientationTest:
    """One-way analysis of variance of slopes, per axis, between orientations of one device."""

    p_value: FloatArray
    """(3,) probability of so large a difference if orientation did not matter."""
    difference: FloatArray
    """(3,) largest difference between the orientations' mean slopes [unit/K]."""


@dataclass(frozen=True, eq=False)
class Compatibility:
    """Normalised difference of two devices' slopes, per axis (compatible: at most 1)."""

    devices: tuple[str, str]
    normalised_difference: FloatArray
    """(3,) |b₁ − b₂| / √(U₁² + U₂²), U = 2 standard uncertainties of the mean slope."""
    opposite: NDArray[np.bool_]
    """(3,) slopes of opposite sign, both beyond their expanded uncertainty."""


def block_slopes(
    recording: ImuRecording, values: FloatArray, kept: NDArray[np.bool_] | None = None
) -> FloatArray:
    """Return the least-squares slopes of `values` (n, 3) per cycle, (blocks, 3) [unit/K]."""
    used = np.isfinite(values).all(axis=1) & np.isfinite(recording.temperature)
    if kept is not None:
        used &= kept
    slopes = [
        _slope(recording.temperature[rows], values[rows]) for rows in _blocks(recording, used)
    ]
    found = [slope for slope in slopes if slope is not None]
    return np.array(found) if found else np.empty((0, 3))


def compare_orientations(by_orientation: Mapping[str, FloatArray]) -> OrientationTest | None:
    """Compare slopes (cycles, 3) between orientations; None where there is nothing to compare."""
    groups = [slopes for slopes in by_orientation.values() if len(slopes) >= 2]
    if len(groups) < 2:
        return None
    means = np.array([group.mean(axis=0) for group in groups])
    return OrientationTest(_f_test(groups), np.ptp(means, axis=0))


def _f_test(groups: Sequence[FloatArray]) -> FloatArray:
    """Return the p-value (3,) of the one-way analysis of variance of groups (cycles, 3)."""
    everything = np.concatenate(groups)
    count, kinds = len(everything), len(groups)
    within = np.sum([((group - group.mean(axis=0)) ** 2).sum(axis=0) for group in groups], axis=0)
    between = ((everything - everything.mean(axis=0)) ** 2).sum(axis=0) - within
    ratio = (between / (kinds - 1)) / (within / (count - kinds))
    p_value: FloatArray = fdtrc(kinds - 1, count - kinds, ratio)
    return p_value


def compare_devices(slopes: Mapping[str, FloatArray]) -> list[Compatibility]:
    """Compare slopes (cycles, 3) between every two devices."""
    names = [name for name, values in slopes.items() if len(values) >= 2]
    return [
        _compatibility((first, second), (slopes[first], slopes[second]))
        for i, first in enumerate(names)
        for second in names[i + 1 :]
    ]


def mean_and_uncertainty(slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean slope and its standard uncertainty, from the scatter of the cycles."""
    if len(slopes) < 2:
        return slopes.mean(axis=0) if len(slopes) else np.full(3, np.nan), np.full(3, np.nan)
    return slopes.mean(axis=0), slopes.std(axis=0, ddof=1) / np.sqrt(len(slopes))


def _compatibility(names: tuple[str, str], pair: Sequence[FloatArray]) -> Compatibility:
    (first, u_first), (second, u_second) = (mean_and_uncertainty(slopes) for slopes in pair)
    normalised = np.abs(first - second) / (2.0 * np.hypot(u_first, u_second))
    certain = (np.abs(first) > 2.0 * u_first) & (np.abs(second) > 2.0 * u_second)
    return Compatibility(names, normalised, (first * second < 0.0) & certain)


def _blocks(recording: ImuRecording, used: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    if recording.cycle is not None and (recording.cycle > 0).any():
        numbers = np.unique(recording.cycle[recording.cycle > 0])
        return [used & (recording.cycle == number) for number in numbers]
    place = np.linspace(0, BLOCKS_WITHOUT_CYCLES, len(recording), endpoint=False).astype(int)
    return [used & (place == number) for number in range(BLOCKS_WITHOUT_CYCLES)]


def _slope(temperature: FloatArray, values: FloatArray) -> FloatArray | None:
    if len(temperature) < 3 or np.ptp(temperature) < LEAST_SPAN_K:
        return None
    x = temperature - temperature.mean()
    slope: FloatArray = x @ (values - values.mean(axis=0)) / (x @ x)
    return slope
