# SPDX-License-Identifier: Apache-2.0
"""Logged quantities other than temperatures that act on sensors, directly or through others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imu_recording.logging_contract import THERMOMETER_FIELDS, TRACK_OF_FIELD

from thermal_comp.data.conditions import CHANNELS, SENSORS, Sensor

if TYPE_CHECKING:
    from thermal_comp.effects.effect import Effect

THERMAL_CHANNELS = tuple(name for name in THERMOMETER_FIELDS if name in CHANNELS)
"""Temperatures around the die."""
MACHINES = ('heater', 'compressor')
"""Channels of the chamber's machines that make heat and cold."""


@dataclass(frozen=True)
class ActingChannel:
    """What is known about a channel that acts on sensors."""

    field: str
    """Field of ImuRecording."""
    through: tuple[str, ...] = ()
    """Channels through which it may act, likeliest first. Where they were not logged, a residual
    that follows it is attributed to the first of them."""

    @property
    def label(self) -> str:
        """Name in an answer: what a residual depends on."""
        return channel_label(self.field)

    @property
    def topic(self) -> str:
        """Topic to log it on."""
        return TRACK_OF_FIELD[self.field].topic


ACTING_CHANNELS = (
    ActingChannel('heater', ('supply_voltage', 'compressor', 'vibration')),
    ActingChannel('compressor', ('vibration', 'supply_voltage')),
    ActingChannel('supply_voltage'),
    ActingChannel('vibration'),
    ActingChannel('humidity'),
    ActingChannel('pressure'),
    ActingChannel('fan'),
)
"""The channels that act, those whose absence explains most first. A field of a machine or its
current reaches the magnetometer, its vibration and the supply the others."""


def channel_label(field: str) -> str:
    """Return the name of a channel in an answer."""
    return field.removesuffix('_voltage')


def acting_on(sensor: Sensor, catalogue: Mapping[str, type[Effect]]) -> tuple[ActingChannel, ...]:
    """Return the channels that effects of the catalogue make act on a sensor.

    They do so directly or through another channel; one that was not logged may be behind what is
    unexplained there.
    """
    needed = {c for e in catalogue.values() if sensor in e.sensors for c in e.channels}
    return tuple(c for c in ACTING_CHANNELS if needed.intersection((c.field, *c.through)))


def topics_to_log(variable: str | None, catalogue: Mapping[str, type[Effect]]) -> list[str]:
    """Return the topics to log where a variable was missing, 'chamber' for both machines of one.

    Of a variable that is no channel they are those of all channels through which effects act.
    """
    topics = {name: TRACK_OF_FIELD[name].topic for name in THERMAL_CHANNELS[:1]}
    topics |= {channel.label: channel.topic for channel in ACTING_CHANNELS}
    if variable in topics:
        return [topics[variable]]
    if variable == 'chamber':
        return [topics[machine] for machine in MACHINES]
    acting = {channel for sensor in SENSORS for channel in acting_on(sensor, catalogue)}
    idle = {channel.label for channel in ACTING_CHANNELS if channel not in acting}
    return [topic for label, topic in topics.items() if label not in idle]


def what_to_log(variable: str | None, catalogue: Mapping[str, type[Effect]]) -> str:
    """Return what to log where a variable was missing; not every device is in a chamber."""
    topics = ', '.join(topics_to_log(variable, catalogue))
    if variable != 'chamber':
        return topics
    return f'what switches near the device, a motor or a lamp (in a chamber {topics})'
