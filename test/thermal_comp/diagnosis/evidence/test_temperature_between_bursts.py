# SPDX-License-Identifier: Apache-2.0
"""What remembers the temperature is named although nobody read it between bursts."""

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.noise.of_runs import determined_noise

from ...campaign import PERIOD, chamber, lagging, run

BURST, EVERY = 6, 180
"""Rows of a burst, and from one to the next: 30 s, every quarter of an hour."""
LOOK_ALIKES = (
    'thermal_lag', 'thermal_lag_two_stage', 'thermal_hysteresis', 'temperature_rate', 'warm_up',
    'bias_temperature_curvature',
)  # fmt: skip


@pytest.mark.long
def test_a_lag_in_bursts_as_far_apart_as_a_ramp_is_long_keeps_its_name() -> None:
    """Corners of the course between bursts make an error that no other effect is."""
    time, temperature, *_ = chamber()
    behind = temperature - lagging(temperature, 900.0, PERIOD)
    error = {'angular_velocity': 4e-4 * behind[:, None] * np.array([1.0, -0.5, 0.7])}
    shown = np.arange(len(time)) % EVERY < BURST
    runs = prepare([
        run(up, seed=k, error=error).rows(np.roll(shown, 45 * k))
        for k, up in enumerate(('+x', '+y', '+z'))
    ])  # fmt: skip
    base = {'gyroscope': (BiasTemperature(),)}
    noise = determined_noise(runs, base)[0]
    said = search_sensors(
        runs, base, noise, Settings({name: EFFECTS[name] for name in LOOK_ALIKES})
    )['gyroscope']
    assert said.probability_of('thermal_lag') > 0.9
