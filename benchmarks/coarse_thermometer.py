# SPDX-License-Identifier: Apache-2.0
"""The temperature between the counts of a thermometer: python benchmarks/coarse_thermometer.py.

Courses of rooms, freezers, ramps with dwells and heatings that go on and off, read in counts of
1/16 to 1 K with noise of 0 to 0.1 count. Error of the smoothed temperature over that of the
readings, and over what it says it may be. Exit code 1 where a claim does not hold.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

import numpy as np
from imu_recording.recording import FloatArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from thermal_comp.data.coarse_thermometer import coarse_course
from thermal_comp.data.smoothing import smoothed_temperature
from verdict import Verdict, judge

STEP_S, ROWS = 2.0, 15_000
TIME: FloatArray = np.asarray(np.arange(ROWS) * STEP_S)
COUNTS_K = (1.0, 0.5, 0.125, 0.0625)
NOISES = (0.0, 0.02, 0.1)
"""Noise of a reading [counts]."""


def behind(values: FloatArray, lag: float) -> FloatArray:
    """Return values (n,) through a first-order lag [s]."""
    k = STEP_S / (lag + STEP_S)
    return np.asarray(lfilter([k], [1.0, k - 1.0], values, zi=[values[0] * (1.0 - k)])[0])


def room(rng: np.random.Generator) -> FloatArray:
    slow = gaussian_filter1d(np.cumsum(rng.standard_normal(ROWS)), 1200.0 / STEP_S)
    return np.asarray(22.0 + 2.0 * (slow - slow.mean()) / slow.std())


def freezer(_: np.random.Generator) -> FloatArray:
    return np.asarray(25.0 - 45.0 * np.exp(-TIME / (0.25 * TIME[-1])))


def ramps(_: np.random.Generator) -> FloatArray:
    corners = np.array([0.0, 2000.0, 2600.0, 6000.0, 7200.0, 12_000.0, 13_800.0, TIME[-1]])
    return behind(np.interp(TIME, corners, [20.0, 20.0, 40.0, 40.0, 0.0, 0.0, 60.0, 60.0]), 60.0)


def on_and_off(rng: np.random.Generator) -> FloatArray:
    edges = np.cumsum(rng.uniform(300.0, 1500.0, 100))
    heats = np.searchsorted(edges, TIME) % 2 == 0
    return np.asarray(20.0 + behind(behind(np.asarray(4.0 * heats), 400.0), 30.0))


COURSES: tuple[Callable[[np.random.Generator], FloatArray], ...] = (
    room,
    freezer,
    ramps,
    on_and_off,
)


def measure() -> Iterator[tuple[str, float, float]]:
    """Yield what was read, the error over that of the readings, and over what is said."""
    for make in COURSES:
        for count in COUNTS_K:
            for noise in NOISES:
                rng = np.random.default_rng(3)
                true = make(rng)
                noisy = true + noise * count * rng.standard_normal(ROWS)
                readings = np.asarray(count * np.round(noisy / count))
                error = smoothed_temperature(TIME, readings) - true
                course = coarse_course(readings)
                said = np.nan
                if course is not None:
                    errors = course.errors(np.arange(ROWS, dtype=float), 24)
                    said = float(error.std() / np.sqrt((errors**2).sum(axis=1).mean()))
                name = f'{make.__name__}, {count:g} K, noise {noise:g}'
                yield name, float(error.std() / (readings - true).std()), said


def main() -> int:
    """Print the ratios and judge them; 0 where the claims hold."""
    ratios = []
    print(f'{"":36}{"error / reading":>16}{"error / said":>14}')
    for name, ratio, said in measure():
        ratios.append(ratio)
        print(f'{name:36}{ratio:16.2f}{said:14.2f}', flush=True)
    better = float(np.mean(np.array(ratios) < 1.0))
    print(f'median {np.median(ratios):.2f}, better than the readings in {better:.0%}')
    claims = [
        Verdict('median error, over that of the readings', float(np.median(ratios)), 0.5),
        Verdict('share not better than the readings', 1.0 - better, 0.1),
    ]
    return 1 if judge(claims) else 0


if __name__ == '__main__':
    sys.exit(main())
