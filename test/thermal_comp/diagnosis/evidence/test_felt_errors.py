# SPDX-License-Identifier: Apache-2.0
"""Effects keep their names where the temperature is not known: in gaps, behind a lag."""

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.noise.of_runs import determined_noise

from imu_recording import ImuRecording

from ...campaign import PERIOD, SLOPES, WHITE, chamber, coloured, lagging, run

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


def cold_start(seed: int) -> ImuRecording:
    """Out of the freezer into a warm room: a gyroscope that follows the die's rate of change.

    The thermometer is 6 s behind the die; a row a second.
    """
    time, rng = np.arange(0.0, 1500.0), np.random.default_rng(seed)
    board = lagging(np.where(time < 2.0, -15.0, 22.0), 250.0, 1.0)
    die = lagging(board, 30.0, 1.0)
    shown = lagging(die, 6.0, 1.0) + 0.04 * rng.standard_normal(len(time))
    still = run(seed=seed)
    rows = {name: getattr(still, name)[: len(time)] for name in SLOPES}
    noise = WHITE['angular_velocity'] * coloured((len(time), 3), rng, 1.0)
    felt = 0.015 * np.gradient(die, time)[:, None] * np.array([1.0, -0.6, 0.3])
    slope = (die - 20.0)[:, None] * SLOPES['angular_velocity']
    rows['angular_velocity'] = noise + felt + slope
    return ImuRecording(
        stamp=(time * 1e9).astype(np.int64) + 1_700_000_000_000_000_000,
        temperature=np.round(shown / 0.0625) * 0.0625,
        device='board',
        run=f'cold {seed}',
        up_axis='+z',
        **rows,
    )


def test_a_rate_beside_a_thermometer_that_lags_is_no_warm_up() -> None:
    """The rate of the reading begins later than that of the die; a warm-up begins at once."""
    runs = prepare([cold_start(1)])
    base = {'gyroscope': (BiasTemperature(),)}
    noise = determined_noise(runs, base)[0]
    names = ('temperature_rate', 'warm_up', 'bias_creep', 'thermal_lag', 'bias_step')
    said = search_sensors(runs, base, noise, Settings({name: EFFECTS[name] for name in names}))
    first = said['gyroscope'].explanations[0]
    assert first.names == ('temperature_rate',)
    assert first.probability > 0.8
