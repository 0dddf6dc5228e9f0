# SPDX-License-Identifier: Apache-2.0
from dataclasses import fields

import numpy as np
import pytest
from imu_recording.bags.reader import read_bag
from imu_recording.recording import columns_hash
from independent_simulator.campaign import FIELDS, Campaign, draw_campaign
from independent_simulator.laws import CATALOGUE, OUTSIDE
from thermal_comp.effects import EFFECTS

import thermal_comp as tc


def measured_magnitude(campaign: Campaign, number: int) -> float:
    """Return what plain least squares leaves of an effect, on the most affected channel.

    Regressors: a constant per run and the recorded temperature.
    """
    effect, hidden = campaign.truth.effects[number], campaign.truth.hidden[number]
    runs = campaign.recordings
    design = np.zeros((sum(len(run) for run in runs), len(runs) + 1))
    design[:, -1] = np.concatenate([run.temperature for run in runs])
    row = 0
    for column, run in enumerate(runs):
        design[row : row + len(run), column] = 1.0
        row += len(run)
    sizes = []
    for sensor in effect.sensors:
        error = np.concatenate([of_run[sensor] for of_run in hidden])
        residual = error - design @ np.linalg.lstsq(design, error, rcond=None)[0]
        sizes.append(np.sqrt(np.mean(residual**2, axis=0)) / campaign.truth.one_second[sensor])
    return float(np.max(sizes))


def test_magnitude_is_what_plain_least_squares_leaves():
    hide = [(name, 7.0) for name in (*CATALOGUE, *OUTSIDE)]
    campaign = draw_campaign(5, 'aborted', hide=hide, rivals=False)
    measured = {
        name: measured_magnitude(campaign, number) for number, (name, _) in enumerate(hide)
    }
    assert measured == pytest.approx(dict(hide), rel=1e-6)


def test_hidden_error_is_in_the_measurement_and_nothing_else_changes():
    """The difference of two recordings of one seed, with and without the effect."""
    with_it, without = (
        draw_campaign(3, 'two_cycles_one_pose', hide=hide, rivals=False)
        for hide in ([('thermal_hysteresis', 20.0)], [])
    )
    (sensor,) = with_it.truth.effects[0].sensors
    for one, field in FIELDS.items():
        difference = getattr(with_it.recordings[0], field) - getattr(without.recordings[0], field)
        hidden = with_it.truth.hidden[0][0][one] if one == sensor else 0.0
        assert np.abs(difference - hidden).max() < 0.2 * with_it.truth.one_second[one]


def test_noise_has_the_stated_level():
    campaign = draw_campaign(1, 'single_sweep', hide=[], rivals=False)
    recording, truth = campaign.recordings[0], campaign.truth
    period = np.median(np.diff(recording.time))
    for sensor, field in FIELDS.items():
        noise = getattr(recording, field) - truth.error[0][sensor]
        white = np.diff(noise, axis=0).std() / np.sqrt(2.0)
        expected = truth.one_second[sensor] / np.sqrt(period)
        assert white == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize('scenario', ['single_sweep', 'hair_dryer', 'bursts', 'with_gaps'])
def test_seed_makes_the_campaign(scenario):
    first, second, other = (draw_campaign(seed, scenario, rivals=False) for seed in (8, 8, 9))
    assert str(first.truth.to_dict()) == str(second.truth.to_dict())
    hashes = [[columns_hash(run) for run in one.recordings] for one in (first, second, other)]
    assert hashes[0] == hashes[1] != hashes[2]
    assert all(np.all(np.diff(run.stamp) > 0) for run in first.recordings)


def test_names_are_those_of_the_catalogue():
    """All that a diagnosis looks for."""
    assert set(CATALOGUE) <= {name for name, effect in EFFECTS.items() if effect.searched}
    assert not set(OUTSIDE) & set(EFFECTS)


def test_unlogged_says_that_a_needed_track_is_missing():
    hide = [('supply_sensitivity', 5.0)]
    logged = draw_campaign(4, 'irrelevant_channels', hide=hide, rivals=False)
    dropped = draw_campaign(4, 'no_chamber_channels', hide=hide, rivals=False)
    assert (logged.truth.unlogged, dropped.truth.unlogged) == (False, True)
    assert dropped.recordings[0].supply_voltage is None


@pytest.mark.parametrize('name', ['fixture_tilt', 'turn_on_bias'])
def test_law_the_recording_cannot_show_is_refused(name):
    """One pose turns nothing, one thermal cycle is one level."""
    with pytest.raises(ValueError, match=name):
        draw_campaign(1, 'single_sweep', hide=[(name, 5.0)])


def test_campaign_goes_through_a_bag(tmp_path):
    campaign = draw_campaign(2, 'cold_start_20min', rivals=False)
    campaign.write(tmp_path)
    recording = campaign.recordings[0]
    read = read_bag(tmp_path / recording.run)
    for item in fields(recording):
        column = getattr(recording, item.name)
        if item.name in FIELDS.values():
            np.testing.assert_array_equal(getattr(read, item.name), column)
    assert len(read) == len(recording)


@pytest.mark.long
def test_a_step_that_fast_noise_was_taken_for_is_named():
    """The step, fitted as slow noise, leaves hardly any for white noise."""
    campaign = draw_campaign(3349, 'single_sweep', hide=[('bias_step', 16.3)], rivals=False)
    found = tc.diagnose(campaign.recordings).findings
    assert [f.name for f in found if f.sensor == 'accelerometer'] == ['bias_step']


@pytest.mark.long
def test_a_scale_factor_in_two_poses_is_not_excluded_by_a_tilt_of_the_device():
    """Two poses hardly tell it from misalignment, and nobody states a tilt of half a degree."""
    drawn = draw_campaign(3370, 'no_chamber_channels')
    (hidden,) = drawn.truth.to_dict()['effects']
    said = tc.diagnose(drawn.recordings).explanations
    named = {e.names: e.probability for e in said if e.sensor == 'accelerometer'}
    assert (hidden['name'], hidden['sensors']) == ('scale_factor_temperature', ('accelerometer',))
    assert named['scale_factor_temperature',] > 0.5
