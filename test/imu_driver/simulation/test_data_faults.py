# SPDX-License-Identifier: Apache-2.0
"""Faults of the data: each changes what it names and leaves the rest alone."""

import numpy as np
import pytest
from imu_driver.board.lsm9ds1 import COUNT_MAX
from imu_driver.simulation.data_faults import FAULTS, UNIT_FACTORS, saturate
from imu_driver.simulation.devices import draw_device
from imu_driver.simulation.environment import Environment, constant_environment
from imu_driver.simulation.read_out import ReadOut, read_out
from imu_driver.simulation.run import DeviceRun, prepare_run
from imu_recording.recording import SENSOR_FIELDS

from imu_recording import ImuRecording


@pytest.fixture(scope='module')
def runs() -> list[DeviceRun]:
    environment = constant_environment(20.0, 20_000.0, period=10.0)
    return [prepare_run(draw_device(3), environment, seed=(1, k)) for k in range(2)]


@pytest.fixture(scope='module')
def recordings(runs: list[DeviceRun]) -> list[ImuRecording]:
    return [read_out(run, ReadOut(0.2, mean=True)) for run in runs]


def changed_rows(
    before: list[ImuRecording], name: str, sensor: str, size: float = 1.0
) -> list[np.ndarray]:
    """Rows of a sensor that a fault changes, per run; the other sensors stay."""
    after = FAULTS[name](before, sensor, size, np.random.default_rng(4))
    for other, field in SENSOR_FIELDS.items():
        for old, new in zip(before, after, strict=True):
            if other != sensor:
                np.testing.assert_array_equal(getattr(new, field), getattr(old, field))
    field = SENSOR_FIELDS[sensor]
    return [
        np.flatnonzero((getattr(new, field) != getattr(old, field)).any(axis=1))
        for old, new in zip(before, after, strict=True)
    ]


def test_spikes_are_single_rows(recordings: list[ImuRecording]) -> None:
    for rows in changed_rows(recordings, 'spikes', 'gyroscope'):
        assert len(rows) == 20


def test_a_stuck_triad_repeats_itself_for_minutes(recordings: list[ImuRecording]) -> None:
    after = FAULTS['stuck_value'](recordings, 'accelerometer', 1.0, np.random.default_rng(4))
    for recording in after:
        same = (np.diff(recording.linear_acceleration, axis=0) == 0.0).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(int), [0]])))
        assert np.diff(edges)[::2].max() * 5.0 >= 60.0


def test_a_unit_mismatch_is_in_one_run(recordings: list[ImuRecording]) -> None:
    rows = changed_rows(recordings, 'unit_mismatch', 'magnetometer')
    assert sorted(len(r) for r in rows) == [0, len(recordings[0])]
    assert UNIT_FACTORS['magnetometer'] == 1e6


def test_a_flip_needs_two_cycles(recordings: list[ImuRecording]) -> None:
    with pytest.raises(ValueError, match='at least two cycles'):
        changed_rows(recordings, 'orientation_flip', 'accelerometer')


def test_saturation_reaches_the_rail_for_the_share_asked_for() -> None:
    time = np.arange(0.0, 20_000.0, 10.0)
    ramp = prepare_run(draw_device(3), Environment(time, 0.002 * time), seed=1)
    (run,) = saturate([ramp], 'gyroscope', 2.0)
    recording = read_out(run, ReadOut(0.2))
    rail = COUNT_MAX * run.device.gyroscope.sensitivity
    at_rail = np.isclose(recording.angular_velocity, rail).mean(axis=0)
    assert at_rail.max() == pytest.approx(0.2, abs=0.05)
    assert np.sort(at_rail)[1] == 0.0
