# SPDX-License-Identifier: Apache-2.0
"""Logged quantities other than temperatures that act on sensors, and by which way."""

from __future__ import annotations

from dataclasses import dataclass

from imu_recording.logging_contract import THERMOMETER_FIELDS, TRACK_OF_FIELD

from thermal_comp.data.conditions import CHANNELS, INERTIAL_SENSORS, SENSORS, Sensor

THERMAL_CHANNELS = tuple(name for name in THERMOMETER_FIELDS if name in CHANNELS)
"""Channels that tell how heat reaches the die."""
MACHINES = ('heater', 'compressor')
"""Channels of the chamber's machines that make heat and cold."""


@dataclass(frozen=True)
class ActingChannel:
    """What is known about a channel that acts on sensors."""

    field: str
    """Field of ImuRecording."""
    acts_on: tuple[Sensor, ...] = ()
    """Sensors on which an effect of the catalogue makes it act, directly or through another
    channel: what is unexplained there may be this one where it was not logged."""
    through: tuple[str, ...] = ()
    """Channels through which it may act, likeliest first: what follows it is theirs where they
    were not logged."""

    @property
    def label(self) -> str:
        """Name in an answer: what a residual depends on."""
        return channel_label(self.field)

    @property
    def topic(self) -> str:
        """Topic to log it on."""
        return TRACK_OF_FIELD[self.field].topic


ACTING_CHANNELS = (
    ActingChannel('heater', SENSORS, ('supply_voltage', 'compressor', 'vibration')),
    ActingChannel('compressor', SENSORS, ('vibration', 'supply_voltage')),
    ActingChannel('supply_voltage', SENSORS),
    ActingChannel('vibration', INERTIAL_SENSORS),
    ActingChannel('humidity', SENSORS),
    ActingChannel('pressure'),
    ActingChannel('fan'),
)
"""The channels that act, those whose absence explains most first. A field of a machine or its
current reaches the magnetometer, its vibration and the supply the others."""


def channel_label(field: str) -> str:
    """Return the name of a channel in an answer."""
    return field.removesuffix('_voltage')


def acting_on(sensor: Sensor) -> tuple[ActingChannel, ...]:
    """Return the channels that an effect of the catalogue makes act on a sensor."""
    return tuple(channel for channel in ACTING_CHANNELS if sensor in channel.acts_on)


def topics_to_log() -> dict[str, str]:
    """Return the topic of each channel whose absence an answer may name, by its label."""
    air = {name: TRACK_OF_FIELD[name].topic for name in THERMAL_CHANNELS[:1]}
    return air | {channel.label: channel.topic for channel in ACTING_CHANNELS if channel.acts_on}
