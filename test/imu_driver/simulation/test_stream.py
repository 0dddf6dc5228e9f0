# SPDX-License-Identifier: Apache-2.0
"""The device sample by sample shows the same physics as the device in one go."""

import numpy as np
import pytest
from imu_driver.board.lsm9ds1 import DEFAULT_FULL_SCALE, SENSORS, scale, temperature_from_counts
from imu_driver.simulation.devices import DEVICES
from imu_driver.simulation.environment import LOCAL_GRAVITY, constant_environment
from imu_driver.simulation.read_out import simulate_device
from imu_driver.simulation.stream import SimulatedDevice
from imu_recording.recording import SENSOR_FIELDS

SCALE = np.concatenate([scale(sensor, DEFAULT_FULL_SCALE[sensor]) for sensor in SENSORS])


def stream(device: str, air: float, count: int, rate: float, seed: int = 1) -> np.ndarray:
    """(count, 10): nine channels in SI, right-handed, and the thermometer [°C]."""
    source = SimulatedDevice(device, seed=seed, full_scale=DEFAULT_FULL_SCALE, orientation='+x')
    rows = []
    for k in range(count):
        gyroscope, accelerometer, magnetometer, thermometer = source.sample(k / rate, air)
        rows.append(
            [
                *(np.array([*gyroscope, *accelerometer, *magnetometer]) * SCALE),
                temperature_from_counts(thermometer),
            ]
        )
    return np.array(rows)


@pytest.mark.parametrize('device', DEVICES)
def test_change_from_cold_to_hot_is_the_slope(device: str) -> None:
    cold, hot = (stream(device, air, 1500, 119.0) for air in (-10.0, 50.0))
    parameters = DEVICES[device]
    change = (hot.mean(axis=0) - cold.mean(axis=0))[:9] / 60.0
    slope = np.concatenate([parameters.sensor(sensor).slope for sensor in SENSORS])
    white = np.concatenate([parameters.sensor(sensor).mean_std for sensor in SENSORS])
    # Two independent means of 12.6 s: white noise and flicker of both.
    assert np.all(np.abs(change - slope) < 3.0 * white / 60.0 + 0.01 * np.abs(slope))


def test_level_noise_and_gravity_agree_with_the_recording() -> None:
    samples = stream('dut1', 20.0, 3000, 119.0)
    recording = simulate_device(
        'dut1', constant_environment(20.0, 25.0), rate_hz=119.0, seed=1, orientation='+x'
    )
    for number, sensor in enumerate(SENSORS):
        values = getattr(recording, SENSOR_FIELDS[sensor])
        mine = samples[:, 3 * number : 3 * number + 3]
        np.testing.assert_allclose(mine.std(axis=0), values.std(axis=0), rtol=0.08)
    assert samples[:, 3].mean() == pytest.approx(LOCAL_GRAVITY, abs=0.2)
    assert samples[:, 9].mean() == pytest.approx(recording.temperature.mean(), abs=0.05)


def test_full_scale_can_change_between_samples() -> None:
    source = SimulatedDevice('dut1', seed=1, full_scale=DEFAULT_FULL_SCALE, orientation='+x')
    fine = source.sample(0.0, 20.0)[1][0]
    source.full_scale = {**source.full_scale, 'accelerometer': 8.0}
    coarse = source.sample(0.01, 20.0)[1][0]
    assert fine / coarse == pytest.approx(4.0, rel=0.01)
    assert source.full_scale['accelerometer'] == 8.0


def test_chip_axes_of_the_magnetometer_are_left_handed() -> None:
    source = SimulatedDevice('dut1', seed=1, full_scale=DEFAULT_FULL_SCALE, orientation='+x')
    assert source.sample(0.0, 20.0)[2][0] > 0  # up axis sees −40 µT; the chip's x points away


def test_equal_seeds_and_calls_give_equal_counts() -> None:
    np.testing.assert_array_equal(stream('dut2', 20.0, 700, 50.0), stream('dut2', 20.0, 700, 50.0))
    other = stream('dut2', 20.0, 700, 50.0, seed=2)
    assert np.any(other != stream('dut2', 20.0, 700, 50.0))


def test_a_step_of_the_air_arrives_through_the_board() -> None:
    source = SimulatedDevice('dut1', seed=1, full_scale=DEFAULT_FULL_SCALE)
    source.sample(0.0, 20.0)
    start = source.die_temperature
    for k in range(1, 111):
        source.sample(float(k), 30.0)
    assert 5.0 < source.die_temperature - start < 7.5  # 63 % of 10 K after some 110 s
    assert source.rate_factor != 1.0
