# SPDX-License-Identifier: Apache-2.0
"""A room's temperature is found between the counts of a thermometer of half a kelvin."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from thermal_comp.data.coarse_thermometer import coarse_course

COUNT = 0.5


def room(hours: float, step: float, seed: int) -> NDArray[np.float64]:
    """°C of a room whose heating goes on and off."""
    time = np.arange(0.0, hours * 3600.0, step)
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(len(time)))
    slow = gaussian_filter1d(walk, 1200.0 / step)
    return np.asarray(22.0 + 2.0 * (slow - slow.mean()) / slow.std())


def read(true: NDArray[np.float64], noise: float, a_row: int = 1) -> NDArray[np.float64]:
    """Rows that are means of so many readings."""
    rng = np.random.default_rng(7)
    noisy = true[:, None] + noise * rng.standard_normal((len(true), a_row))
    return np.asarray((COUNT * np.round(noisy / COUNT)).mean(axis=1))


@pytest.mark.parametrize(('noise', 'largest'), [(0.0, 0.65), (0.02, 0.35), (0.06, 0.25)])
@pytest.mark.parametrize('a_row', [1, 2, 5])
def test_what_noise_toggles_and_what_is_held_tell_the_course(
    noise: float, largest: float, a_row: int
) -> None:
    ratios, said = [], []
    for seed in range(4):
        true = room(20.0, 2.0, seed)
        readings = read(true, noise, a_row)
        found = coarse_course(readings)
        assert found is not None
        rows = np.arange(len(true))
        error = found.at(rows) - true
        ratios.append(error.std() / (readings - true).std())
        said.append(np.sqrt((found.errors(rows, 24) ** 2).sum(axis=1).mean()) / error.std())
    assert np.mean(ratios) < largest
    assert 0.4 < np.median(said) < 2.5


def test_what_it_may_be_off_is_where_no_count_is_passed() -> None:
    time = np.arange(0.0, 20_000.0, 5.0)
    true = 20.0 + 4.0 * np.tanh((time - 10_000.0) / 2_000.0)
    found = coarse_course(read(true, 0.03))
    assert found is not None
    size = np.sqrt((found.errors(np.arange(len(time)), 24) ** 2).sum(axis=1))
    ramp, dwell = np.abs(time - 10_000.0) < 2_000.0, time > 17_000.0
    assert size[dwell].mean() > 5.0 * size[ramp].mean()
    assert size.max() <= COUNT / np.sqrt(12.0) * (1.0 + 1e-9)


@pytest.mark.parametrize(
    'readings',
    [
        read(room(5.0, 2.0, 1), 0.3),
        np.full(1000, 21.5),
        np.repeat(read(room(5.0, 20.0, 1), 0.02), 2),
        read(room(0.01, 2.0, 1), 0.02),
    ],
    ids=['noise above its counts', 'one count', 'read every other row', 'few rows'],
)
def test_of_others_nothing_is_claimed(readings: NDArray[np.float64]) -> None:
    assert coarse_course(readings) is None
