# SPDX-License-Identifier: Apache-2.0
"""Units a CSV column may be in, as factor and offset to the recording's unit."""

from __future__ import annotations

import math

from imu_recording.up_axis import GRAVITY

_RATE = {
    'rad/s': 1.0,
    'mrad/s': 1e-3,
    'deg/s': math.pi / 180,
    '°/s': math.pi / 180,
    'mdeg/s': math.pi / 180e3,
    'deg/h': math.pi / 180 / 3600,
}
_FORCE = {'m/s²': 1.0, 'm/s^2': 1.0, 'm/s2': 1.0, 'g': GRAVITY, 'mg': 1e-3 * GRAVITY}
_FIELD = {
    'T': 1.0,
    'mT': 1e-3,
    'µT': 1e-6,
    'uT': 1e-6,
    'nT': 1e-9,
    'G': 1e-4,
    'gauss': 1e-4,
    'mG': 1e-7,
}
_SHARE = {'1': 1.0, '%': 0.01}
_CELSIUS = {'°C': (1.0, 0.0), 'C': (1.0, 0.0), 'K': (1.0, -273.15)}
_FAHRENHEIT = dict.fromkeys(('°F', 'F'), (5 / 9, -32 * 5 / 9))
_TEMPERATURE = _CELSIUS | _FAHRENHEIT

TIME_UNITS = {'s': 1e9, 'ms': 1e6, 'µs': 1e3, 'us': 1e3, 'ns': 1.0, 'min': 60e9, 'h': 3600e9}
"""Nanoseconds per unit of a time column."""
ISO_TIME = 'iso8601'
"""Unit of a time column that holds dates such as 2014-01-02T12:00:00.5."""

UNITS: dict[str, dict[str, tuple[float, float]]] = {
    'angular_velocity': {unit: (factor, 0.0) for unit, factor in _RATE.items()},
    'linear_acceleration': {unit: (factor, 0.0) for unit, factor in _FORCE.items()},
    'magnetic_field': {unit: (factor, 0.0) for unit, factor in _FIELD.items()},
    'temperature': _TEMPERATURE,
    'chamber_temperature': _TEMPERATURE,
    'chamber_temperature_2': _TEMPERATURE,
    'device_temperature': _TEMPERATURE,
    'setpoint': _TEMPERATURE,
    'humidity': {unit: (factor, 0.0) for unit, factor in _SHARE.items()},
    'heater': {unit: (factor, 0.0) for unit, factor in _SHARE.items()},
    'compressor': {unit: (factor, 0.0) for unit, factor in _SHARE.items()},
    'fan': {unit: (factor, 0.0) for unit, factor in _SHARE.items()},
    'supply_voltage': {'V': (1.0, 0.0), 'mV': (1e-3, 0.0)},
}
"""By field of ImuRecording and unit: (factor, offset) to that field's unit."""

VECTORS = ('angular_velocity', 'linear_acceleration', 'magnetic_field')
"""Fields that take three columns."""
