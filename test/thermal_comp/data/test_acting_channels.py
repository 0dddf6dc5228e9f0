# SPDX-License-Identifier: Apache-2.0
"""Every channel of the logging contract is known to act, or is a temperature."""

from imu_recording.logging_contract import CHANNEL_FIELDS, SWITCHED_FIELDS, THERMOMETER_FIELDS
from thermal_comp.data.acting_channels import (
    ACTING_CHANNELS,
    THERMAL_CHANNELS,
    acting_on,
    topics_to_log,
)
from thermal_comp.data.conditions import CHANNELS, SENSORS
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature

ACTING = {channel.field: channel for channel in ACTING_CHANNELS}


def test_every_channel_of_the_contract_acts_or_is_a_temperature() -> None:
    assert {*ACTING, *THERMOMETER_FIELDS, 'setpoint'} == set(CHANNEL_FIELDS)
    assert set(SWITCHED_FIELDS) <= set(ACTING)


def test_an_absent_channel_is_suspected_on_every_sensor_that_its_effects_act_on() -> None:
    acting = {sensor: [c.field for c in acting_on(sensor, EFFECTS)] for sensor in SENSORS}
    every = ['heater', 'compressor', 'supply_voltage']
    assert acting['accelerometer'] == acting['gyroscope'] == [*every, 'vibration', 'humidity']
    assert acting['magnetometer'] == [*every, 'humidity']


def test_an_effect_of_a_user_makes_its_channel_act_on_its_sensors() -> None:
    class Barometric(BiasTemperature):
        sensors = ('gyroscope',)
        channels = ('pressure',)

    catalogue = {**EFFECTS, 'barometric': Barometric}
    acting = {sensor: [c.field for c in acting_on(sensor, catalogue)] for sensor in SENSORS}
    assert [s for s in SENSORS if 'pressure' in acting[s]] == ['gyroscope']
    assert 'imu/pressure' in topics_to_log(None, catalogue)
    assert 'imu/pressure' not in topics_to_log(None, EFFECTS)


def test_channels_act_through_channels_that_were_or_were_not_logged() -> None:
    assert {name for channel in ACTING_CHANNELS for name in channel.through} <= set(ACTING)
    assert set(THERMAL_CHANNELS) <= set(CHANNELS)


def test_the_advice_names_the_topic_of_the_contract() -> None:
    assert topics_to_log('supply', EFFECTS) == ['imu/supply_voltage']
    assert topics_to_log('chamber_temperature', EFFECTS) == ['chamber/temperature']
    assert topics_to_log('pressure', EFFECTS) == ['imu/pressure']
    assert topics_to_log('chamber', EFFECTS) == ['chamber/heater', 'chamber/compressor']
