# SPDX-License-Identifier: Apache-2.0
"""A room's temperature is found between the counts of a thermometer of half a kelvin."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from thermal_comp.data.coarse_thermometer import coarse_course
from thermal_comp.data.conditions import settled_conditions
from thermal_comp.data.smoothing import errors_between_counts
from thermal_comp.data.thermometer_counts import counts_of

from ..campaign import lagging

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


@pytest.mark.parametrize(('noise', 'largest'), [(0.0, 0.65), (0.02, 0.35), (0.06, 0.3)])
@pytest.mark.parametrize('a_row', [1, 2, 5])
def test_what_noise_toggles_and_what_is_held_tell_the_course(
    noise: float, largest: float, a_row: int
) -> None:
    ratios, said = [], []
    for seed in range(4):
        true = room(20.0, 2.0, seed)
        readings = read(true, noise, a_row)
        found = coarse_course(readings, counts_of(read(true, noise)))
        assert found is not None
        rows = np.arange(len(true))
        error = found.at(rows) - true
        ratios.append(error.std() / (readings - true).std())
        said.append(np.sqrt((found.errors(rows, 24) ** 2).sum(axis=1).mean()) / error.std())
    assert np.mean(ratios) < largest
    assert 0.3 < np.median(said) < 2.5


def test_what_it_may_be_off_is_where_no_count_is_passed() -> None:
    time = np.arange(0.0, 20_000.0, 5.0)
    true = 20.0 + 4.0 * np.tanh((time - 10_000.0) / 2_000.0)
    found = coarse_course(read(true, 0.03))
    assert found is not None
    size = np.sqrt((found.errors(np.arange(len(time)), 24) ** 2).sum(axis=1))
    ramp, dwell = np.abs(time - 10_000.0) < 2_000.0, time > 17_000.0
    assert size[dwell].mean() > 5.0 * size[ramp].mean()
    assert size.max() <= COUNT / np.sqrt(12.0) * (1.0 + 1e-9)


@pytest.mark.parametrize('count', [0.0625, 0.125, 0.5, 1.0])
@pytest.mark.parametrize('noise', [0.0, 0.1])
def test_dwells_at_round_temperatures_tell_no_larger_count(count: float, noise: float) -> None:
    time = np.arange(0.0, 12_000.0, 2.0)
    air = np.interp(
        time, [0, 2000, 2600, 6000, 6600, 12_000], [20.0, 20.0, 40.0, 40.0, 20.0, 20.0]
    )
    true = lagging(air, 60.0, 2.0)
    noisy = true + noise * count * np.random.default_rng(1).standard_normal(len(time))
    readings = count * np.round(noisy / count)
    assert np.diff(counts_of(readings)) == pytest.approx(count)
    found = coarse_course(readings)
    assert found is not None
    rows = np.arange(len(time))
    error, size = found.at(rows) - true, np.sqrt((found.errors(rows, 24) ** 2).sum(axis=1))
    assert error.std() < (readings - true).std()
    assert size.mean() > 0.3 * np.abs(error).mean()


@pytest.mark.parametrize('count', [0.0625, 0.125, 1.0 / 3.0, 5.0 / 9.0])
def test_counts_are_found_in_readings_that_are_rounded_to_decimals(count: float) -> None:
    true = 20.0 + 20.0 * np.sin(np.arange(0.0, 60.0, 0.005))
    found = counts_of(np.round(count * np.round(true / count), 2))
    assert np.diff(found) == pytest.approx(count, abs=0.0101)
    assert len(found) == round((found[-1] - found[0]) / count) + 1


def test_spikes_and_fine_thermometers_have_no_counts() -> None:
    readings = read(room(5.0, 2.0, 1), 0.02)
    spiky = readings.copy()
    spiky[1000] = 1e8
    assert counts_of(spiky) == counts_of(readings)
    assert counts_of(room(5.0, 2.0, 1)) == ()
    assert counts_of(np.full(100, np.nan)) == ()


def test_many_pieces_share_the_errors_of_all() -> None:
    true = room(10.0, 2.0, 3)
    time = np.arange(len(true)) * 2.0 + 500.0 * (np.arange(len(true)) // 700)
    still = settled_conditions(20.0)
    nothing = np.zeros((len(true), 3))
    conditions = replace(
        still,
        time=time,
        temperature=read(true, 0.02),
        specific_force=nothing,
        angular_velocity=nothing,
        magnetic_field=nothing,
    )
    errors = errors_between_counts(conditions)
    assert errors.shape == (len(true), 24)
    assert np.count_nonzero(errors.any(axis=1)) > 0.1 * len(true)


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
