# SPDX-License-Identifier: Apache-2.0
"""A thermometer that lags shows in all sensors alike: that is no effect of any of them."""

from dataclasses import replace

import numpy as np

import thermal_comp as tc
from imu_recording import ImuRecording

from ..campaign import chamber, lagging, run

UP = ('+x', '+y', '+z')
SLOPES = {
    'linear_acceleration': 2e-2 * np.array([1.0, -0.6, 1.4]),
    'angular_velocity': 2e-3 * np.array([1.0, 1.5, -0.8]),
    'magnetic_field': 2e-6 * np.array([1.0, -1.2, 0.7]),
}
"""Ten to twenty times those of the quiet device: what the thermometer is off by shows."""


def late(time_constant: float, **own: np.ndarray) -> list[ImuRecording]:
    """Return a campaign whose thermometer follows the die, with further errors of its own."""
    time, die, *_ = chamber()
    read = lagging(die, time_constant, float(time[1] - time[0]))
    steep = {name: (die - 20.0)[:, None] * slope for name, slope in SLOPES.items()}
    errors = {name: steep[name] + own.get(name, 0.0) for name in steep}
    return [replace(run(up, seed=k, error=errors), temperature=read) for k, up in enumerate(UP)]


def named(recordings: list[ImuRecording]) -> set[tuple[str, str | None]]:
    found = tc.diagnose(recordings).findings
    return {(f.sensor, f.name) for f in found if f.kind not in {'noise', 'quality'}}


def test_a_lag_in_proportion_to_the_slopes_of_all_sensors_is_the_thermometers() -> None:
    assert named(late(25.0)) == set()


def test_a_lag_of_one_sensor_beside_it_keeps_its_name() -> None:
    time, die, *_ = chamber()
    behind = die - lagging(die, 400.0, float(time[1] - time[0]))
    lag = 4e-4 * behind[:, None] * np.array([1.0, -0.5, 0.8])
    assert named(late(25.0, angular_velocity=lag)) == {('gyroscope', 'thermal_lag')}
