# SPDX-License-Identifier: Apache-2.0
"""The simulated chamber behaves like a chamber: regulated, limited, moist, and reproducible."""

from dataclasses import fields

import numpy as np
import pytest
from chamber_profile.profile.file import load_profile
from chamber_profile.run.simulation import simulate_chamber
from imu_recording.phase import phases_from_setpoint
from imu_recording.recording import PHASES

PAPER = load_profile('paper_betta2022')


@pytest.fixture(scope='module')
def run():
    return simulate_chamber(PAPER, seed=4)


def in_phase(run, name: str) -> np.ndarray:
    return run.phase == PHASES.index(name)


def settled(run, name: str) -> np.ndarray:
    """Rows of a phase whose set-point has stood for five minutes."""
    moving = np.abs(np.diff(run.setpoint, prepend=run.setpoint[0])) > 0
    since = np.arange(len(run.time)) - np.maximum.accumulate(
        np.where(moving, np.arange(len(run.time)), 0)
    )
    return in_phase(run, name) & (since > 300)


def test_air_is_regulated_within_0_3_kelvin_in_every_dwell(run) -> None:
    for name in ('dwell_cold', 'dwell_hot', 'dwell_reference', 'final'):
        rows = settled(run, name)
        assert rows.sum() > 1000
        assert np.abs(run.air - run.setpoint)[rows].max() < 0.3


def test_the_run_takes_twelve_hours_and_ramps_at_two_kelvin_per_minute(run) -> None:
    assert 12 * 3600 <= run.time[-1] < 12.2 * 3600
    for name, rate in (('ramp_up', 2.0), ('ramp_down', -2.0)):
        rows = in_phase(run, name) & (np.abs(run.setpoint - 20) < 25)
        joined = rows[1:] & rows[:-1] & (np.diff(run.time) == 1.0)
        assert np.diff(run.temperature)[joined].mean() * 60 == pytest.approx(rate, rel=0.02)


def test_phases_agree_with_those_derived_from_the_setpoint(run) -> None:
    rows = run.time > 600  # from when the set-point stands at the reference
    phase, cycle = phases_from_setpoint(run.time[rows], run.setpoint[rows])
    assert np.mean(phase == run.phase[rows]) > 0.98
    assert np.mean(cycle == run.cycle[rows]) > 0.98


def test_cold_needs_the_compressor_and_hot_ramps_the_heater(run) -> None:
    assert run.compressor[in_phase(run, 'dwell_cold')].mean() > 0.9
    assert run.heater[in_phase(run, 'ramp_up')].mean() > 0.15
    assert run.compressor[settled(run, 'dwell_hot')].mean() < 0.1


def test_the_compressor_keeps_its_minimum_times(run) -> None:
    switches = np.flatnonzero(np.diff(run.compressor))
    assert len(switches) >= 8
    assert np.diff(switches).min() >= 180


def test_humidity_follows_from_temperature(run) -> None:
    assert 0.0 < run.humidity.min() < 0.25  # the same vapour in warmer air
    assert run.humidity[in_phase(run, 'ramp_down')].max() > 0.9
    assert run.humidity.max() <= 1.0


def test_the_two_pt100_differ_as_sensors_do(run) -> None:
    rows = settled(run, 'dwell_hot')
    apart = np.abs(run.temperature - run.temperature_2)[rows].mean()
    assert 0.005 < apart < 0.6
    assert run.temperature[rows].std() < 0.2


def test_equal_seeds_give_equal_runs_and_others_do_not() -> None:
    short = load_profile('short_20min')
    first, again, other = (simulate_chamber(short, seed=seed) for seed in (1, 1, 2))
    for item in fields(first):
        np.testing.assert_array_equal(getattr(first, item.name), getattr(again, item.name))
    assert np.abs(first.temperature[:600] - other.temperature[:600]).max() > 0.01


def test_a_longer_period_picks_the_same_rows() -> None:
    short = load_profile('short_20min')
    fine, coarse = simulate_chamber(short, seed=3), simulate_chamber(short, seed=3, period_s=10)
    np.testing.assert_array_equal(fine.temperature[::10][: len(coarse.time)], coarse.temperature)
    with pytest.raises(ValueError, match='whole number'):
        simulate_chamber(short, seed=3, period_s=0.5)
