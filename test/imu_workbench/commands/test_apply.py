# SPDX-License-Identifier: Apache-2.0
"""apply: bags without the slope, every topic kept, one bag for each."""

from pathlib import Path

import numpy as np
import yaml
from imu_recording.bags.messages import bag_topics, read_messages
from imu_workbench.__main__ import main

from imu_recording import read_bag, write_bag


def test_apply_removes_the_slope(device_bags: Path, dut1_model: Path, tmp_path: Path) -> None:
    target = tmp_path / 'compensated'
    assert (
        main(['apply', str(device_bags / 'dut1'), '--model', str(dut1_model), '-o', str(target)])
        == 0
    )
    before, after = read_bag(device_bags / 'dut1'), read_bag(target)
    np.testing.assert_array_equal(before.stamp, after.stamp)
    np.testing.assert_array_equal(before.temperature, after.temperature)
    for name in ('angular_velocity', 'linear_acceleration', 'magnetic_field'):
        old = np.polyfit(before.temperature, getattr(before, name), 1)[0]
        new = np.polyfit(after.temperature, getattr(after, name), 1)[0]
        assert (np.abs(new) < 0.02 * np.abs(old).max()).all()


def test_apply_keeps_every_topic_and_adds_its_own(
    robot: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    bag, rules = robot
    model, out, again = (str(tmp_path / name) for name in ('m.yaml', 'out', 'again'))
    topics = ['--topics', str(rules)]
    assert main(['fit', str(bag), *topics, '-o', model]) == 0
    assert main(['apply', str(bag), *topics, '--model', model, '-o', out]) == 0
    before, after = bag_topics(bag), bag_topics(out)
    assert set(after) - set(before) == {
        f'/imu_compensated/{name}' for name in ('data_raw', 'mag', 'applied_model')
    }
    assert read_messages(out, list(before)) == read_messages(bag, list(before))
    # What apply wrote is read as compensated, and nothing is subtracted twice unasked.
    temperature = ['--topic', 'imu/temperature:=/camera/temperature']
    capsys.readouterr()
    for argv in (
        ['apply', out, *temperature, '--model', model, '-o', again],
        ['fit', out, *temperature, '-o', again],
        ['diagnose', out, *temperature],
        ['orient', out, *temperature, '--model', model],
    ):
        assert main(argv) == 2
        assert 'compensated already (model of' in capsys.readouterr().err
    remap = {'imu/temperature': '/camera/temperature'}
    assert read_bag(out, remap=remap).compensated.startswith('model of a device without name')
    assert not read_bag(out, remap=yaml.safe_load(rules.read_text())).compensated
    told = {**remap, 'imu/data_raw': '/imu_compensated/data_raw'}
    assert read_bag(out, remap=told).compensated


def test_apply_of_several_writes_one_bag_each(
    device_bags: Path, dut1_model: Path, tmp_path: Path
) -> None:
    write_bag(read_bag(device_bags / 'dut1'), tmp_path / 'second')
    bags = [str(device_bags / 'dut1'), str(tmp_path / 'second')]
    target = tmp_path / 'out'
    assert main(['apply', *bags, '--model', str(dut1_model), '-o', str(target)]) == 0
    assert sorted(p.name for p in target.iterdir()) == ['dut1', 'second']
    assert main(['apply', *bags, '--model', str(dut1_model), '-o', str(target)]) == 2
