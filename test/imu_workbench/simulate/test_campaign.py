# SPDX-License-Identifier: Apache-2.0
"""Simulated experiments: chamber, device and logging together, and the bags that ship."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from imu_driver.simulation.devices import DEVICES
from imu_recording.logging_contract import CHANNEL_FIELDS
from imu_recording.recording import PHASES, SENSOR_FIELDS, columns_hash
from imu_workbench.simulate.campaign import (
    Logging,
    hold_tracks,
    simulate_campaign,
    simulate_run,
)
from imu_workbench.simulate.motion import ROTATIONS, known_rotations, simulate_motion
from scipy.spatial.transform import Rotation

from imu_recording import read_bag, write_bag

SHORT = 'short_20min'


@pytest.fixture(scope='module')
def bag_maker() -> ModuleType:
    path = Path(__file__).resolve().parents[3] / 'bags' / 'make.py'
    spec = importlib.util.spec_from_file_location('make_bags', path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_track_of_the_logging_contract_is_there() -> None:
    recording = simulate_run(SHORT, 'dut1', Logging(0.5), seed=1, orientation='-y')
    for name in CHANNEL_FIELDS:
        value = getattr(recording, name)
        assert (value is None) == (name in {'vibration', 'pressure'}), name
        if value is not None:
            assert np.isfinite(value).mean() > 0.99, name
    assert recording.phase is not None
    assert [PHASES[k] for k in dict.fromkeys(recording.phase.tolist())] == list(PHASES)
    assert (recording.device, recording.up_axis, recording.run, recording.profile) == (
        'dut1',
        '-y',
        'dut1_-y',
        SHORT,
    )
    assert recording.linear_acceleration[:, 1].mean() < -9.0


def test_the_die_follows_the_air_and_stays_above_it() -> None:
    recording = simulate_run(SHORT, 'dut2', Logging(0.5), seed=1)
    assert recording.chamber_temperature is not None
    warmer = recording.temperature - recording.chamber_temperature
    offset = DEVICES['dut2'].thermometer_offset
    hot = recording.phase == PHASES.index('dwell_hot')
    assert -1.0 < np.median(warmer[hot]) - offset < 1.5
    # It comes two minutes late.
    assert np.corrcoef(recording.temperature, recording.chamber_temperature)[0, 1] > 0.8


def test_a_run_alone_is_the_run_of_the_campaign() -> None:
    campaign = simulate_campaign(SHORT, 'dut3', Logging(0.5), seed=7)
    alone = simulate_run(SHORT, 'dut3', Logging(0.5), seed=7, orientation='+x')
    assert columns_hash(alone) == columns_hash(campaign[0])
    starts = [run.stamp[0] for run in campaign]
    np.testing.assert_array_equal(np.diff(starts), 86_400_000_000_000)


def test_equal_seeds_give_equal_columns_and_others_do_not() -> None:
    hashes = {
        columns_hash(simulate_run(SHORT, 'dut1', Logging(0.5), seed=seed)) for seed in (1, 1, 2)
    }
    assert len(hashes) == 2


def test_devices_with_one_seed_share_the_chamber_and_not_the_noise() -> None:
    first, second = (
        simulate_run(SHORT, device, Logging(0.5), seed=1) for device in ('dut1', 'dut2')
    )
    assert first.setpoint is not None
    np.testing.assert_array_equal(first.setpoint, second.setpoint)
    noise = [np.diff(r.linear_acceleration, 2, axis=0) for r in (first, second)]
    for axis in range(3):
        assert abs(np.corrcoef(noise[0][:, axis], noise[1][:, axis])[0, 1]) < 0.2


def test_tracks_keep_their_own_pace_and_come_back_from_a_bag(tmp_path: Path) -> None:
    recording = simulate_run(SHORT, 'dut1', Logging(2.0, chamber_period=10.0), seed=1)
    assert recording.chamber_temperature is not None
    changed = np.flatnonzero(np.diff(recording.chamber_temperature) != 0.0) + 1
    assert np.all(recording.time[changed] % 10.0 < 1e-6)
    assert columns_hash(hold_tracks(recording, 10.0)) == columns_hash(recording)
    write_bag(recording, tmp_path / 'bag')
    assert columns_hash(read_bag(tmp_path / 'bag')) == columns_hash(recording)


def test_means_are_quieter_than_samples_and_carry_the_vibration() -> None:
    samples = simulate_run(SHORT, 'dut1', Logging(0.2), seed=1)
    means = simulate_run(SHORT, 'dut1', Logging(0.2, mean=True), seed=1)
    assert means.vibration is not None
    assert np.all(means.vibration > 0.0)
    for name in SENSOR_FIELDS.values():
        noise = [np.diff(getattr(r, name), 2, axis=0).std(axis=0).max() for r in (samples, means)]
        assert noise[1] < 0.4 * noise[0], name


def test_known_rotations_end_where_they_start() -> None:
    total = Rotation.identity()
    for axis, angle in ROTATIONS:
        total = total * Rotation.from_rotvec(np.deg2rad(angle) * np.array(axis))
    assert np.rad2deg(total.magnitude()) < 1e-6
    last = known_rotations().turns[-1]
    assert last.start + last.duration < 600.0


def test_motion_holds_a_ramp_and_the_true_attitude() -> None:
    recording = simulate_motion('dut1', rate_hz=100.0, seed=4)
    assert recording.time[-1] == pytest.approx(600.0, abs=1.0)
    assert np.ptp(recording.temperature) > 10.0
    assert recording.reference_orientation is not None
    attitude = Rotation.from_quat(recording.reference_orientation)
    force = recording.linear_acceleration - DEVICES['dut1'].accelerometer.bias
    level = attitude.apply(force)
    np.testing.assert_allclose(level.mean(axis=0), [0.0, 0.0, 9.8], atol=0.1)
    assert level.std(axis=0).max() < 0.25


def test_a_shipped_bag_can_be_made_again(bag_maker: ModuleType, bags: Path) -> None:
    shipped, again = read_bag(bags / 'dut2_y'), bag_maker.made('dut2_y')
    np.testing.assert_array_equal(shipped.stamp, again.stamp)
    for name in (*SENSOR_FIELDS.values(), 'temperature'):
        # Another processor may round a count or two differently.
        same = np.mean(getattr(shipped, name) == getattr(again, name))
        assert same > 0.999, name


def test_shipped_bags_are_what_their_table_says(bag_maker: ModuleType, bags: Path) -> None:
    stated = bag_maker.hashes()
    assert sorted(stated) == sorted(bag_maker.NAMES)
    for name in ('dut1_x', 'dut3_z', 'dut1_motion', 'hidden_effect_x'):
        assert columns_hash(read_bag(bags / name)) == stated[name], name
    total = sum(path.stat().st_size for path in bags.rglob('*') if path.is_file())
    assert total < 40e6
