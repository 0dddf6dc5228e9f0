# SPDX-License-Identifier: Apache-2.0
"""The temperature behind a noisy thermometer is found, of ramps and of quiet days alike."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from thermal_comp.data.conditions import Conditions, settled_conditions
from thermal_comp.data.smoothing import (
    MOST_ERRORS,
    errors_between_bursts,
    smoothed_conditions,
    smoothed_temperature,
)
from thermal_comp.effects.operators import follow
from thermal_comp.effects.temperature_rate import TemperatureRate

from ..campaign import lagging

INPUTS = ('specific_force', 'angular_velocity', 'magnetic_field')


def ramps(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and °C up and down at 2 K/min with dwells of half an hour."""
    time = np.arange(0.0, 20_000.0, step)
    rate = 2.0 / 60.0 * np.sign(np.sin(2.0 * np.pi * time / 7200.0))
    dwell = np.abs(np.sin(2.0 * np.pi * time / 7200.0)) < np.sin(np.pi / 4.0)
    return time, 20.0 + np.cumsum(np.where(dwell, 0.0, rate)) * step


def days(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and °C of two days: slow swings of a few kelvin."""
    time = np.arange(0.0, 172_800.0, step)
    wander = np.cumsum(np.random.default_rng(2).standard_normal(len(time)))
    slow = gaussian_filter1d(wander, 1800.0 / step)
    day = 6.0 * np.sin(2.0 * np.pi * time / 86_400.0)
    return time, 15.0 + day + 2.0 * (slow - slow.mean()) / slow.std()


def out_of_the_freezer(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Time and °C of a board behind its package, brought into a warm room and left there."""
    time = np.arange(0.0, 1800.0, step)
    fast, slow = 30.0, 300.0
    shares = (slow * np.exp(-time / slow) - fast * np.exp(-time / fast)) / (slow - fast)
    return time, 22.0 - 37.0 * shares


def rate_error(time: np.ndarray, found: np.ndarray, true: np.ndarray) -> float:
    """Rms [K/s]."""
    return float(np.std(np.gradient(found, time) - np.gradient(true, time)))


@pytest.mark.parametrize(
    ('count', 'noise'), [(0.5, 0.02), (0.25, 0.1), (0.125, 0.05), (0.0625, 0.1)]
)
def test_a_device_that_warms_itself_after_power_on_is_followed(count: float, noise: float) -> None:
    """By 1 K within a minute or two, in a room whose temperature moves in hours."""
    time = np.arange(0.0, 20_000.0)
    room = 20.0 + 3.0 * np.sin(time / 5000.0)
    first, missed, missed_in_room = time < 100.0, [], []
    for seed in range(2):
        error = noise * np.random.default_rng(seed).standard_normal(len(time))
        for true, errors in ((room - np.exp(-time / 25.0), missed), (room, missed_in_room)):
            read = count * np.round((true + error) / count)
            errors.append(np.sqrt(np.mean((smoothed_temperature(time, read) - true)[first] ** 2)))
    assert np.mean(missed) < 0.12 * max(count, 0.5)
    assert np.mean(missed_in_room) < 0.06 * max(count, 0.5)


@pytest.mark.parametrize('noise', [0.01, 0.05])
def test_where_a_course_is_bent_at_first_and_straight_later_no_single_width_is_as_good(
    noise: float,
) -> None:
    time, true = out_of_the_freezer(1.0)
    errors = []
    for seed in range(5):
        measured = true + noise * np.random.default_rng(seed).standard_normal(len(time))
        widths = np.geomspace(2.0, 200.0, 30)
        gaussian = [gaussian_filter1d(measured, w, mode='nearest') for w in widths]
        best = min(rate_error(time, found, true) for found in gaussian)
        errors.append(rate_error(time, smoothed_temperature(time, measured), true) / best)
    assert np.mean(errors) < 0.6


@pytest.mark.parametrize(('made', 'step'), [(ramps, 5.0), (ramps, 1.0), (days, 10.0)])
@pytest.mark.parametrize('noise', [0.01, 0.05])
def test_no_width_of_a_gaussian_finds_rate_better_by_much(made, step: float, noise: float) -> None:
    time, true = made(step)
    measured = true + noise * np.random.default_rng(1).standard_normal(len(time))
    widths = np.geomspace(2.0 * step, 2000.0, 30) / step
    best = min(rate_error(time, gaussian_filter1d(measured, w), true) for w in widths)
    assert rate_error(time, smoothed_temperature(time, measured), true) < 1.15 * best


def test_a_quantised_thermometer_is_smoothed_between_its_counts() -> None:
    time, true = days(10.0)
    noise = 0.04 * np.random.default_rng(1).standard_normal(len(time))
    counts = 0.125 * np.round((true + noise) / 0.125)
    smoothed = smoothed_temperature(time, counts)
    assert np.std(smoothed - true) < 0.6 * np.std(counts - true)


@pytest.mark.parametrize('count', [0.1, 0.25, 0.5, 1.0])
def test_a_coarse_thermometer_without_noise_is_smoothed_through_its_steps(count: float) -> None:
    time = np.arange(0.0, 1200.0)
    true = 22.0 + 14.0 * (1.0 - np.exp(-time / 240.0)) + 2.0 * np.sin(2.0 * np.pi * time / 400.0)
    counts = count * np.round(true / count)
    smoothed = smoothed_temperature(time, counts)
    assert np.std(smoothed - true) < 0.3 * np.std(counts - true)
    steps = np.flatnonzero(np.diff(counts))
    inside = slice(steps[0], steps[-1] + 1)
    assert np.abs(smoothed - true)[inside].max() < 0.25 * count


def test_rows_that_are_means_over_a_step_say_when_it_was() -> None:
    time = np.arange(0.0, 1200.0, 0.1)
    true = 20.0 + 0.03 * time
    readings = 0.5 * np.round(true / 0.5)
    rows = readings.reshape(-1, 10).mean(axis=1)
    smoothed = smoothed_temperature(
        np.arange(0.5, 1200.0), rows, counts=np.unique(readings).tolist()
    )
    inside = slice(40, -40)
    assert np.abs(smoothed - true.reshape(-1, 10).mean(axis=1))[inside].max() < 0.01


def test_a_thermometer_that_is_read_more_seldom_than_the_rows_is_smoothed_as_it_was_read() -> None:
    time, true = ramps(1.0)
    read = true[::10] + 0.05 * np.random.default_rng(1).standard_normal(len(true[::10]))
    rows = np.interp(time, time[::10], read)
    rate = np.gradient(true, time)
    error = [
        np.std(np.gradient(smoothed_temperature(time, rows, s), time) - rate) for s in (0, 10)
    ]
    direct = smoothed_temperature(time[::10], read)
    assert error[1] < 0.3 * error[0]
    assert error[1] < 1.1 * np.std(np.gradient(direct, time[::10]) - rate[::10])


def test_what_lies_beyond_a_gap_is_not_mixed_in() -> None:
    time, true = ramps(5.0)
    later = np.where(np.arange(len(time)) < 2000, 0.0, 40.0)
    noise = 0.02 * np.random.default_rng(1).standard_normal(len(time))
    measured = true + later + noise
    apart = smoothed_temperature(time + 20.0 * later, measured)
    assert np.abs(apart - true - later).max() < 0.2


def test_too_few_rows_stay_as_they_are() -> None:
    values = np.array([20.0, 20.1, 20.0])
    np.testing.assert_array_equal(smoothed_temperature(np.arange(3.0), values), values)


def in_bursts(
    time: np.ndarray, temperature: np.ndarray, every: int, length: int
) -> tuple[Conditions, np.ndarray]:
    """Return what was logged in bursts of so many seconds, and which rows (n,) these are."""
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(time))
    shown = time % every < length
    whole = replace(settled_conditions(20.0), time=time, temperature=temperature + noise)
    whole = replace(whole, **{name: np.zeros((len(time), 3)) for name in INPUTS})
    return whole.rows(shown), shown


@pytest.mark.parametrize(('every', 'length'), [(300, 5), (600, 5), (600, 60), (1800, 60)])
def test_bursts_tell_rate_and_lag_by_the_course_between_them(every: int, length: int) -> None:
    time, true = ramps(1.0)
    package = lagging(true, 300.0, 1.0)
    slow = lagging(package, 600.0, 1.0)
    there, shown = in_bursts(time, package, every, length)
    smooth, row = smoothed_conditions(there)
    np.testing.assert_allclose(smooth.time[row], time[shown], atol=1e-9)
    rate = TemperatureRate().columns_in_hindsight(smooth)[row, 0]
    true_rate = np.gradient(package, time)[shown]
    assert np.std(rate - true_rate) < 0.15 * np.std(true_rate)
    behind = (follow(smooth.time, smooth.temperature, 600.0)[0] - smooth.temperature)[row]
    true_behind = (slow - package)[shown]
    assert np.std(behind - true_behind) < 0.15 * np.std(true_behind)


@pytest.mark.parametrize(('every', 'length'), [(600, 5), (900, 5), (1800, 60)])
def test_the_curve_through_bursts_misses_no_more_than_is_said(every: int, length: int) -> None:
    time, true = ramps(1.0)
    package = lagging(true, 300.0, 1.0)
    there, _ = in_bursts(time, package, every, length)
    smooth, _ = smoothed_conditions(there)
    missed = np.abs(smooth.temperature - np.interp(smooth.time, time, package))
    said = errors_between_bursts(there)
    gaps = len(np.unique(there.time // every)) - 1
    assert said.shape == (len(smooth), min(gaps, MOST_ERRORS))
    between = said.any(axis=1)
    allowed = said[between].sum(axis=1)
    assert (missed[between] < 2.0 * allowed + 0.05).mean() > 0.9
    assert np.sqrt((allowed**2).mean()) < 0.25 * package.std()


def test_nothing_is_missed_where_there_are_no_bursts() -> None:
    time, true = ramps(5.0)
    there, _ = in_bursts(time, true, 5, 5)
    assert errors_between_bursts(there).shape == (len(time), 0)
