# SPDX-License-Identifier: Apache-2.0
"""What the simulated device records: slopes and spread of the tables, noise, counts, clock."""

from dataclasses import replace

import numpy as np
import pytest
from imu_driver.board.lsm9ds1 import COUNT_MAX, DEFAULT_FULL_SCALE, SENSITIVITY
from imu_driver.simulation.devices import (
    DEVICES,
    MEAN_STD,
    SENSOR_RATE_HZ,
    draw_device,
)
from imu_driver.simulation.environment import (
    LOCAL_GRAVITY,
    MAGNETIC_FIELD,
    Environment,
    constant_environment,
)
from imu_driver.simulation.noise import flicker_noise
from imu_driver.simulation.read_out import ReadOut, read_out, simulate_device
from imu_driver.simulation.run import prepare_run
from imu_driver.simulation.thermal import DIE
from imu_recording.recording import SENSOR_FIELDS

TABLE_RUN = {'dut1': '+x', 'dut2': '+y', 'dut3': '+z'}
SPREAD_R1 = {  # Tables III–V, σ of R1: dps, m/s², µT
    'dut1': ((0.04, 0.06, 0.01), (0.24, 0.14, 0.28), (6.43, 4.97, 6.83)),
    'dut2': ((0.07, 0.09, 0.03), (0.11, 0.16, 0.18), (11.15, 10.40, 4.94)),
    'dut3': ((0.06, 0.08, 0.04), (0.04, 0.14, 0.12), (10.92, 14.62, 6.98)),
}
UNIT = {'gyroscope': np.deg2rad(1.0), 'accelerometer': 1.0, 'magnetometer': 1e-6}


def plan_cycle(start: float = 600.0) -> Environment:
    """One cycle of the paper's plan after `start` seconds of rest."""
    time = np.arange(0.0, start + 9001.0)
    corners = np.cumsum([0, start, 900, 1800, 1800, 1800, 900, 1800])
    setpoint = np.interp(time, corners, [20, 20, -10, -10, 50, 50, 20, 20])
    cycle = (time >= start).astype(np.int64)
    return Environment(
        time,
        setpoint,
        setpoint=setpoint,
        cycle=cycle,
        compressor=(time // 600 % 2),
        heater=np.full(len(time), 0.2),
    )


@pytest.fixture(scope='module')
def plan() -> Environment:
    return plan_cycle()


def allan_deviation(values: np.ndarray, length: int) -> np.ndarray:
    blocks = values[: len(values) // length * length].reshape(-1, length, values.shape[1])
    return np.sqrt(0.5 * np.mean(np.diff(blocks.mean(axis=1), axis=0) ** 2, axis=0))


@pytest.mark.parametrize('device', DEVICES)
def test_spread_over_a_cycle_is_the_tables(device: str, plan: Environment) -> None:
    recording = simulate_device(device, plan, rate_hz=0.5, seed=4, orientation=TABLE_RUN[device])
    assert recording.cycle is not None
    rows = recording.cycle == 1
    for sensor, printed in zip(UNIT, SPREAD_R1[device], strict=True):
        spread = getattr(recording, SENSOR_FIELDS[sensor])[rows].std(axis=0) / UNIT[sensor]
        # Within the table's last digit, or 3 % where that is finer than the plan's timing.
        np.testing.assert_allclose(spread, printed, rtol=0.03, atol=0.005, err_msg=sensor)


@pytest.mark.parametrize('device', DEVICES)
@pytest.mark.parametrize('sensor', SENSOR_FIELDS)
def test_slopes_are_the_parameters(device: str, sensor: str, plan: Environment) -> None:
    run = prepare_run(device, plan, seed=2, orientation='+z')
    recording = read_out(run, ReadOut(0.2, mean=True))
    true = np.interp(recording.time + 5.0, plan.time, run.nodes[:, DIE])
    slope = np.polyfit(true, getattr(recording, SENSOR_FIELDS[sensor]), 1)[0]
    wanted = run.device.sensor(sensor).slope
    noise = MEAN_STD[sensor] / 20.0  # flicker over the plan, per kelvin
    np.testing.assert_allclose(slope, wanted, atol=noise)


def test_two_devices_have_opposite_slopes_of_magnetometer_x() -> None:
    first, second = (DEVICES[name].magnetometer.slope[0] for name in ('dut1', 'dut2'))
    assert first < -0.1e-6
    assert second > 0.1e-6


def test_gravity_and_field_turn_with_the_orientation() -> None:
    device = draw_device(3)
    still = constant_environment(20.0, 600.0)
    seen = {}
    for axis in ('+x', '-x', '+y', '-y', '+z', '-z'):
        recording = simulate_device(device, still, rate_hz=1.0, seed=1, orientation=axis)
        force = recording.linear_acceleration.mean(axis=0)
        seen[axis] = force
        up = 'xyz'.index(axis[1])
        assert force[up] * (1 if axis[0] == '+' else -1) == pytest.approx(LOCAL_GRAVITY, abs=0.8)
        field = recording.magnetic_field.mean(axis=0) - device.magnetometer.bias
        assert np.linalg.norm(field) == pytest.approx(np.linalg.norm(MAGNETIC_FIELD), rel=0.02)
    for up in range(3):  # the bias is what does not turn
        pair = 0.5 * (seen['+' + 'xyz'[up]] + seen['-' + 'xyz'[up]])
        assert pair[up] == pytest.approx(device.accelerometer.bias[up], abs=0.02)


@pytest.mark.parametrize('sensor', SENSOR_FIELDS)
def test_white_noise_of_samples_and_means(sensor: str) -> None:
    device = draw_device(5)
    part = replace(device.sensor(sensor), bias_instability=0.0)
    device = replace(device, **{sensor: part})
    still = constant_environment(20.0, 4000.0)
    single = simulate_device(device, still, rate_hz=1.0, seed=1)
    mean = simulate_device(device, still, rate_hz=0.2, seed=1, mean=True)
    for recording, wanted in ((single, np.sqrt(SENSOR_RATE_HZ)), (mean, np.sqrt(0.2))):
        values = getattr(recording, SENSOR_FIELDS[sensor])
        std = np.diff(values, axis=0).std(axis=0) / np.sqrt(2.0)
        np.testing.assert_allclose(std, wanted * MEAN_STD[sensor], rtol=0.12)


def test_bias_instability_is_a_flat_allan_deviation() -> None:
    noise = flicker_noise(40_000, 1.0, np.full(40, 3.0), np.random.default_rng(1))
    flat = 3.0 * np.sqrt(2.0 * np.log(2.0) / np.pi)
    for length in (60, 200, 600, 2000):
        deviation = np.sqrt(np.mean(allan_deviation(noise, length) ** 2))
        assert deviation == pytest.approx(flat, rel=0.12), length


def test_samples_are_counts(plan: Environment) -> None:
    recording = simulate_device('dut2', plan, rate_hz=0.5, seed=1)
    for sensor, name in SENSOR_FIELDS.items():
        lsb = SENSITIVITY[sensor][DEFAULT_FULL_SCALE[sensor]]
        counts = getattr(recording, name) / lsb
        np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    sixteenths = recording.temperature * 16.0
    np.testing.assert_array_equal(sixteenths, np.rint(sixteenths))


def test_counts_saturate() -> None:
    device = DEVICES['dut1']
    strong = replace(device.magnetometer, bias=np.array([520e-6, -520e-6, 0.0]))
    still = constant_environment(20.0, 60.0)
    recording = simulate_device(replace(device, magnetometer=strong), still, rate_hz=1.0, seed=1)
    lsb = device.magnetometer.sensitivity
    assert np.all(recording.magnetic_field[:, 0] == COUNT_MAX * lsb)
    assert np.all(recording.magnetic_field[:, 1] == (-COUNT_MAX - 1) * lsb)


def test_thermometer_has_its_offset_and_gain(plan: Environment) -> None:
    run = prepare_run('dut3', plan, seed=1)
    recording = read_out(run, ReadOut(0.5))
    true = np.interp(recording.time, plan.time, run.nodes[:, DIE])
    gain, level = np.polyfit(true - 20.0, recording.temperature - 20.0, 1)
    assert gain == pytest.approx(1.0 + run.device.thermometer_gain, abs=2e-4)
    assert level == pytest.approx(run.device.thermometer_offset, abs=0.01)


def test_the_sensors_clock_drifts_with_temperature() -> None:
    device = DEVICES['dut1']
    paces = []
    for air in (-10.0, 50.0):
        still = constant_environment(air, 300.0)
        recording = simulate_device(device, still, rate_hz=50.0, seed=1)
        paces.append((len(recording) - 1) / recording.time[-1])
    change = (paces[1] - paces[0]) / 50.0
    assert change == pytest.approx(device.rate_slope * 60.0, rel=0.02)
    assert abs(device.rate_slope) > 1e-5


def test_the_hosts_timer_does_not_drift(plan: Environment) -> None:
    recording = simulate_device('dut1', plan, rate_hz=0.5, seed=1)
    np.testing.assert_array_equal(np.diff(recording.stamp), 2_000_000_000)


def test_supply_moves_the_outputs_little_and_is_logged(plan: Environment) -> None:
    run = prepare_run('dut1', plan, seed=3)
    recording = read_out(run, ReadOut(0.5))
    assert recording.supply_voltage is not None
    assert 1e-3 < recording.supply_voltage.std() < 2e-2
    moved = np.ptp(run.supply) * abs(run.device.accelerometer.supply_slope)
    assert moved < 0.1 * MEAN_STD['accelerometer']


def test_equal_seeds_give_equal_recordings(plan: Environment) -> None:
    first, again, other = (
        simulate_device('dut1', plan, rate_hz=0.5, seed=seed) for seed in (1, 1, 2)
    )
    for name in (*SENSOR_FIELDS.values(), 'temperature', 'supply_voltage', 'device_temperature'):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
        assert np.any(getattr(first, name) != getattr(other, name)), name


def test_a_start_up_transient_scales_every_channel_alike() -> None:
    run = prepare_run('dut1', constant_environment(20.0, 1200.0), seed=1, orientation='+x')
    settled = read_out(run, ReadOut(1.0))
    rising = read_out(run, ReadOut(1.0, startup_time=100.0))
    for name in SENSOR_FIELDS.values():
        ratio = getattr(rising, name)[0] / getattr(settled, name)[0]
        np.testing.assert_allclose(ratio, 0.543, rtol=1e-6)
    np.testing.assert_allclose(
        rising.linear_acceleration[-1], settled.linear_acceleration[-1], rtol=1e-4
    )


def test_field_jumps_are_the_tables_levels() -> None:
    plan = plan_cycle()
    twice = replace(plan, cycle=np.where(plan.time < 4000.0, 1, 2))
    run = prepare_run('dut2', twice, seed=1, orientation='+y')
    jumping = prepare_run('dut2', twice, seed=1, orientation='+y', field_jumps=True)
    jump = (jumping.errors['magnetometer'] - run.errors['magnetometer']) * 1e6
    np.testing.assert_allclose(jump[:4000], 0.0, atol=1e-9)
    wanted = np.array([-27.29, 8.63, 83.52]) - np.array([-31.61, -24.47, 13.46])
    np.testing.assert_allclose(jump[4001:], np.broadcast_to(wanted, jump[4001:].shape), rtol=1e-6)


def test_an_unknown_device_is_named() -> None:
    with pytest.raises(ValueError, match=r"'dut9'; there are dut1, dut2, dut3"):
        simulate_device('dut9', constant_environment(20.0, 10.0), rate_hz=1.0, seed=1)
