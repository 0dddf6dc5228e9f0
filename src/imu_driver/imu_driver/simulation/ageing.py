# SPDX-License-Identifier: Apache-2.0
"""A simulated device a year later: what has changed in it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS

from imu_driver.simulation.devices import DeviceParameters
from imu_driver.simulation.effects.hidden_effect import log_uniform

BIAS_CHANGE_TURN_ONS = 5.0
"""Spread of the change of a bias in a year, in spreads from one power-on to the next."""


@dataclass(frozen=True)
class Ageing:
    """What a year changes in a device; ratios are later over earlier."""

    slope_ratio: dict[str, float]
    """Sensor → ratio of its slopes over temperature, the same on its axes."""
    offset: dict[str, tuple[float, ...]]
    """Sensor → (3,) change of its bias [SI unit]."""
    time_constant_ratio: float
    """Ratio of the time constant with which the elements follow the thermometer."""
    effect_ratio: float
    """Ratio of the amplitudes of hidden effects."""

    def of(self, device: DeviceParameters) -> DeviceParameters:
        """Return the device a year later, under the same name."""
        aged: dict[str, Any] = {}
        for sensor in SENSOR_FIELDS:
            part = device.sensor(sensor)
            aged[sensor] = replace(
                part,
                slope=self.slope_ratio[sensor] * part.slope,
                bias=part.bias + np.array(self.offset[sensor]),
            )
        conductance = device.glue_conductance / self.time_constant_ratio
        return replace(device, **aged, glue_conductance=conductance)

    def to_dict(self) -> dict[str, Any]:
        """Return the changes as plain values."""
        return asdict(self)


def draw_ageing(device: DeviceParameters, seed: int) -> Ageing:
    """Return what a year changes: slopes by 15 … 60 %, lag and hidden effects by 20 … 80 %.

    >>> from imu_driver.simulation.devices import DEVICES
    >>> ageing = draw_ageing(DEVICES['dut1'], seed=1)
    >>> all(1.15 <= max(ratio, 1 / ratio) <= 1.6 for ratio in ageing.slope_ratio.values())
    True
    """
    generator = np.random.default_rng((seed, 43))
    ratio = partial(_ratio, generator)
    return Ageing(
        slope_ratio={sensor: ratio(1.15, 1.6) for sensor in SENSOR_FIELDS},
        offset={
            sensor: tuple(
                (BIAS_CHANGE_TURN_ONS * device.sensor(sensor).turn_on_std * change).tolist()
            )
            for sensor, change in zip(
                SENSOR_FIELDS, generator.normal(0.0, 1.0, (3, 3)), strict=True
            )
        },
        time_constant_ratio=ratio(1.2, 1.8),
        effect_ratio=ratio(1.2, 1.8),
    )


def _ratio(generator: np.random.Generator, low: float, high: float) -> float:
    """Return a ratio between the bounds, or as probably its inverse."""
    size = log_uniform(generator, low, high)
    return size if generator.uniform() < 0.5 else 1.0 / size
