# SPDX-License-Identifier: Apache-2.0
"""Campaigns with a hidden effect: what it changes, what it leaves, and the truth beside them."""

from pathlib import Path

import numpy as np
import pytest
from imu_driver.simulation.devices import MEAN_STD
from imu_driver.simulation.hidden import UNLOGGED_EFFECTS
from imu_recording.recording import SENSOR_FIELDS, columns_hash
from imu_workbench.simulate.campaign import Logging
from imu_workbench.simulate.hidden_effect import (
    EffectToHide,
    SimulatedCampaign,
    find_truth,
    hidden_campaign,
)

SHORT = 'short_20min'
MEANS = Logging(0.2, mean=True, chamber_period=5.0)


def campaign(name: str, size: float = 3.0, sensor: str | None = None) -> SimulatedCampaign:
    return hidden_campaign(SHORT, 'dut2', MEANS, [EffectToHide(name, size, sensor)], seed=2)


@pytest.fixture(scope='module')
def plain() -> SimulatedCampaign:
    return campaign('nothing')


def test_nothing_hidden_is_the_campaign_itself(plain: SimulatedCampaign) -> None:
    assert plain.truths[0].kind == 'nothing'
    assert [run.up_axis for run in plain.recordings] == ['+x', '+y', '+z']


@pytest.mark.parametrize('sensor', SENSOR_FIELDS)
def test_an_effect_changes_its_sensor_and_no_other(plain: SimulatedCampaign, sensor: str) -> None:
    found = campaign('thermal_lag', sensor=sensor)
    assert (found.truths[0].name, found.truths[0].sensor) == ('thermal_lag', sensor)
    for run, other in zip(found.recordings, plain.recordings, strict=True):
        for part, name in SENSOR_FIELDS.items():
            same = np.array_equal(getattr(run, name), getattr(other, name))
            assert same == (part != sensor)


@pytest.mark.parametrize('name', UNLOGGED_EFFECTS)
def test_an_unlogged_cause_leaves_no_track(name: str) -> None:
    found = campaign(name)
    assert (found.truths[0].name, found.truths[0].kind) == (None, 'unlogged')
    assert 'chamber' in found.truths[0].depends_on
    for run in found.recordings:
        assert getattr(run, name.removeprefix('unlogged_')) is None


def test_a_track_lost_with_one_effect_is_lost_for_the_others() -> None:
    wanted = [EffectToHide('compressor_hard_iron'), EffectToHide('unlogged_vibration')]
    found = hidden_campaign(SHORT, 'dut2', MEANS, wanted, seed=2)
    assert [truth.kind for truth in found.truths] == ['unlogged', 'unlogged']
    assert found.truths[0].depends_on == ('compressor', 'chamber')
    assert found.truths[0].law == 'compressor_hard_iron'


def test_a_drifting_clock_stretches_the_stamps_with_temperature() -> None:
    found = campaign('clock_temperature')
    slope = found.truths[0].parameters['relative_rate_per_kelvin']
    assert abs(slope) == pytest.approx(60e-6)
    run = found.recordings[0]
    pace = 5.0 / (np.diff(run.stamp) * 1e-9) - 1.0
    fitted = np.polyfit(run.temperature[1:], pace, 1)[0]
    assert fitted == pytest.approx(slope, rel=0.02)


def test_faults_do_what_their_names_say(plain: SimulatedCampaign) -> None:
    stuck = campaign('stuck_value', sensor='gyroscope').recordings[0].angular_velocity
    assert np.sum(np.all(np.diff(stuck, axis=0) == 0.0, axis=1)) > 30
    spiky = campaign('spikes', sensor='gyroscope').recordings[0].angular_velocity
    clean = plain.recordings[0].angular_velocity
    assert np.sum(np.any(spiky != clean, axis=1)) == 40
    odd = campaign('unit_mismatch', sensor='magnetometer').recordings
    ratio = [np.median(np.abs(run.magnetic_field)) for run in odd]
    assert max(ratio) / min(ratio) > 1e5
    full = campaign('saturation', sensor='magnetometer').recordings[0].magnetic_field
    assert np.max(np.mean(full == full.max(axis=0), axis=0)) > 0.05
    first = campaign('startup_transient').recordings[0].linear_acceleration
    whole = plain.recordings[0].linear_acceleration
    np.testing.assert_allclose(first[0] / whole[0], 0.543, rtol=1e-3)


def test_what_needs_cycles_says_so() -> None:
    with pytest.raises(ValueError, match='at least two cycles'):
        campaign('orientation_flip')


def magnitude_of_difference(
    plain: SimulatedCampaign, other: SimulatedCampaign, sensor: str
) -> float:
    """Size of what was added in one-second means: rms beyond level and a line in temperature."""
    left = []
    for run, bare in zip(other.recordings, plain.recordings, strict=True):
        name = SENSOR_FIELDS[sensor]
        difference = getattr(run, name) - getattr(bare, name)
        line = np.column_stack([bare.temperature, np.ones(len(bare))])
        left.append(difference - line @ np.linalg.lstsq(line, difference, rcond=None)[0])
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)) / MEAN_STD[sensor])


def test_several_effects_each_have_their_own_magnitude(plain: SimulatedCampaign) -> None:
    asked = [
        EffectToHide('thermal_lag', 5.0, 'gyroscope'),
        EffectToHide('warm_up', 3.0, 'accelerometer'),
    ]
    both = hidden_campaign(SHORT, 'dut2', MEANS, asked, seed=2)
    assert [(t.name, t.sensor, t.magnitude) for t in both.truths] == [
        ('thermal_lag', 'gyroscope', 5.0),
        ('warm_up', 'accelerometer', 3.0),
    ]
    for truth in both.truths:  # a line per run takes a little more than the common one
        assert truth.sensor is not None
        size = magnitude_of_difference(plain, both, truth.sensor)
        assert 0.8 * truth.magnitude < size < 1.05 * truth.magnitude
    alone = campaign('thermal_lag', 5.0, 'gyroscope')
    assert alone.truths[0] == both.truths[0]


def test_two_effects_in_one_sensor_add_up(plain: SimulatedCampaign) -> None:
    effects = [EffectToHide(name, 3.0, 'gyroscope') for name in ('warm_up', 'thermal_lag')]
    one = hidden_campaign(SHORT, 'dut2', MEANS, effects[:1], seed=2)
    both = hidden_campaign(SHORT, 'dut2', MEANS, effects, seed=2)
    assert both.truths[0] == one.truths[0]
    assert magnitude_of_difference(one, both, 'gyroscope') == pytest.approx(3.0, rel=0.2)
    assert magnitude_of_difference(plain, both, 'accelerometer') == 0.0


def test_a_year_changes_slope_offset_and_lag_of_the_same_device(plain: SimulatedCampaign) -> None:
    lag = [EffectToHide('thermal_lag', 5.0, 'gyroscope')]
    later = hidden_campaign(SHORT, 'dut2', MEANS, lag, seed=2, aged=True)
    first = campaign('thermal_lag', 5.0, 'gyroscope')
    again = hidden_campaign(SHORT, 'dut2', MEANS, lag, seed=2, aged=True)
    assert columns_hash(later.recordings[0]) == columns_hash(again.recordings[0])
    assert {run.device for run in later.recordings} == {'dut2'}
    changes = later.changes
    assert changes is not None
    slopes = [
        np.polyfit(c.recordings[2].temperature, c.recordings[2].linear_acceleration[:, 0], 1)[0]
        for c in (plain, later)
    ]
    assert slopes[1] / slopes[0] == pytest.approx(
        changes['slope_ratio']['accelerometer'], rel=0.03
    )
    (old,), (new,) = first.truths, later.truths
    for key, ratio in (('scale', 'effect_ratio'), ('time_constant', 'time_constant_ratio')):
        assert new.parameters[key] / old.parameters[key] == pytest.approx(changes[ratio])


def test_the_bundled_truth_is_found(bags: Path) -> None:
    truth, found = find_truth(bags)
    assert all(path.is_dir() for path in found)
    assert truth['kind'] == 'effect'
