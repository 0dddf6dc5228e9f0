# SPDX-License-Identifier: Apache-2.0
"""Names in campaigns of the independent simulator that were lost to a law without one.

The sensor in question is diagnosed as of a device that has it alone.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from imu_recording.recording import SENSOR_FIELDS
from independent_simulator.campaign import draw_campaign

import thermal_comp as tc
from imu_recording import ImuRecording


def answer(recordings: Sequence[ImuRecording], sensor: str) -> dict[str, Any]:
    others = [field for name, field in SENSOR_FIELDS.items() if name != sensor]
    alone = [replace(r, **{f: np.full((len(r), 3), np.nan) for f in others}) for r in recordings]
    return tc.diagnose(alone).to_dict()


def explanations(recordings: Sequence[ImuRecording], sensor: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = answer(recordings, sensor)['explanations']
    return found


@pytest.mark.long
def test_a_line_in_bursts_keeps_its_name() -> None:
    # Beside effects that explain nothing, a line that wanders was a law outside the catalogue.
    campaign = draw_campaign(3743, 'bursts')
    assert [effect['name'] for effect in campaign.truth.to_dict()['effects']] == ['mains_alias']
    found = explanations(campaign.recordings, 'gyroscope')
    assert found[0]['names'] == ['mains_alias']
    assert found[0]['probability'] > 0.5


@pytest.mark.long
def test_a_heater_that_was_not_logged_is_told_by_the_air() -> None:
    # The die follows slowly what a heater does: it looked like a compressor's field and a step.
    campaign = draw_campaign(3834, 'different_ranges')
    (hidden,) = campaign.truth.to_dict()['effects']
    assert (hidden['name'], hidden['logged']) == ('heater_hard_iron', False)
    found = [
        e for e in explanations(campaign.recordings, 'magnetometer') if 'unlogged' in e['names']
    ]
    assert sum(e['probability'] for e in found) > 0.5
    assert found[0]['depends_on'] == 'heater'


@pytest.mark.long
def test_noise_that_makes_a_law_disappear_is_not_taken_for_it() -> None:
    # The likelier answer, a law of time under usual noise, was replaced by noise 80 times as loud.
    campaign = draw_campaign(3679, 'two_cycles_one_pose')
    (hidden,) = campaign.truth.to_dict()['effects']
    assert hidden['name'] == 'slow_oscillation'
    found = explanations(campaign.recordings, 'magnetometer')
    assert found[0]['names'] == ['not_in_catalogue']
    assert found[0]['depends_on'] == 'time'


@pytest.mark.long
def test_two_lags_in_place_of_a_memory_have_standard_deviations() -> None:
    # The likeliest pair lay far from the fitted one, and all of the weight among swapped pairs.
    campaign = draw_campaign(3666, 'aborted')
    (hidden,) = campaign.truth.to_dict()['effects']
    assert hidden['name'] == 'fractional_order_memory'
    findings = answer(campaign.recordings, 'magnetometer')['findings']
    (found,) = [f for f in findings if f['name'] == 'thermal_lag_two_stage']
    for parameter in found['parameters'].values():
        assert 0.0 < parameter['std'] < 7200.0


@pytest.mark.long
def test_humidity_that_tells_the_air_is_no_effect_of_humidity() -> None:
    # A thermometer missed what the air of a room did between two bursts; its humidity did not.
    campaign = draw_campaign(3443, 'bursts')
    assert all('gyroscope' not in e['sensors'] for e in campaign.truth.to_dict()['effects'])
    found = explanations(campaign.recordings, 'gyroscope')
    assert found[0]['names'] == ['nothing']
    assert found[0]['probability'] > 0.9


@pytest.mark.long
def test_noise_that_is_far_too_loud_may_have_a_cause() -> None:
    # A supply that jumps between bursts, 38 × the noise, is as likely as noise of that size.
    campaign = draw_campaign(3113, 'bursts')
    (hidden,) = campaign.truth.to_dict()['effects']
    assert (hidden['name'], hidden['logged']) == ('supply_sensitivity', False)
    found = {
        tuple(e['names']): e['probability']
        for e in explanations(campaign.recordings, 'magnetometer')
    }
    assert found['unlogged',] + found['not_in_catalogue',] > 0.5 > found['nothing',]


@pytest.mark.long
def test_a_fast_lag_below_the_noise_may_act() -> None:
    # Both stages had to explain as much: without the fast one it was one lag, 93 % sure.
    campaign = draw_campaign(4331, 'irrelevant_channels')
    effects = {e['name']: e['sensors'] for e in campaign.truth.to_dict()['effects']}
    assert effects['thermal_lag_two_stage'] == ('gyroscope',)
    found = {
        tuple(e['names']): e['probability'] for e in explanations(campaign.recordings, 'gyroscope')
    }
    assert found['thermal_lag',] < 0.9
    assert found['thermal_lag_two_stage',] > 0.1


@pytest.mark.long
def test_surroundings_that_were_not_logged_make_a_rate_and_a_warm_up() -> None:
    # The die heats itself after power-on, so that a difference to its surroundings shows both.
    campaign = draw_campaign(4325, 'several_days')
    (hidden,) = campaign.truth.to_dict()['effects']
    assert (hidden['name'], hidden['logged']) == ('thermal_gradient', False)
    found = explanations(campaign.recordings, 'magnetometer')
    assert found[0]['names'] == ['unlogged']
    assert found[0]['depends_on'] == 'chamber_temperature'
    assert found[0]['probability'] > 0.9


def test_a_thermometer_that_lags_by_many_times_the_noise_is_no_law() -> None:
    # Its errors were too large to be a thermometer's, so that what they left was a law.
    campaign = draw_campaign(11583, 'hair_dryer')
    assert campaign.truth.to_dict()['effects'] == []
    found = explanations(campaign.recordings, 'gyroscope')
    assert found[0]['names'] == ['nothing']
    assert found[0]['probability'] > 0.5
