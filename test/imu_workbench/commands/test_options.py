# SPDX-License-Identifier: Apache-2.0
"""Options that verbs share: device, topics, model, and the noise that counts as normal."""

import doctest
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_recording.user_error import UserError
from imu_workbench.__main__ import build_parser, main
from imu_workbench.commands import options
from imu_workbench.commands.options import noise_reference, read_devices
from imu_workbench.web.case.tasks import read_task
from thermal_comp.model.file import load_model

from imu_recording import read_bag, write_bag


@pytest.fixture
def two_devices(tmp_path: Path, bags: Path) -> Path:
    parts = [read_bag(bags / f'{name}_x').rows(slice(0, 50)) for name in ('dut1', 'dut2')]
    named = [
        replace(part, namespace=space) for part, space in zip(parts, ('/one', '/two'), strict=True)
    ]
    write_bag(named, tmp_path / 'both')
    return tmp_path / 'both'


def test_the_user_has_to_choose(two_devices: Path) -> None:
    with pytest.raises(ValueError, match='/one, /two; choose one with --namespace'):
        read_devices(two_devices, None, {})
    assert [r.device for r in read_devices(two_devices, None, {}, every_device=True)] == [
        'dut1',
        'dut2',
    ]


def test_a_topic_chooses_like_a_namespace(two_devices: Path) -> None:
    topics = {name: f'/two/{name}' for name in ('imu/data_raw', 'imu/mag', 'imu/temperature')}
    (by_topic,) = read_devices(two_devices, None, topics)
    (by_name,) = read_devices(two_devices, '/two', {})
    np.testing.assert_array_equal(by_topic.angular_velocity, by_name.angular_velocity)
    np.testing.assert_array_equal(by_topic.temperature, by_name.temperature)


def test_a_noise_reference_is_a_chip_in_any_spelling_or_a_file() -> None:
    found = noise_reference(Namespace(noise_reference='MPU-9250'), {})
    assert found is not None
    assert (found.name, set(found.sensors)) == ('MPU-9250', {'accelerometer', 'gyroscope'})
    with pytest.raises(UserError, match=r'mpu925: neither a chip \(did you mean mpu9250'):
        noise_reference(Namespace(noise_reference='mpu925'), {})


def test_option_examples_hold() -> None:
    assert doctest.testmod(options).failed == 0


def test_the_page_reads_a_bag_under_its_own_names(
    robot: tuple[Path, Path], tmp_path: Path
) -> None:
    bag, rules = robot
    told = build_parser('serve').parse_args(['serve', str(bag), '--topics', str(rules)])
    (stored,) = read_task(lambda _: None, bag, tmp_path, options.topic_remap(told))
    assert np.isfinite(stored.recording().temperature).all()


def test_a_remapped_imu_is_told_which_temperatures_there_are(
    robot: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    argv = ['fit', str(robot[0]), '--topic', 'imu/data_raw:=/camera/imu']
    assert main([*argv, '-o', str(tmp_path / 'm.yaml')]) == 2
    assert '--topic imu/temperature:=/camera/temperature' in capsys.readouterr().err


def test_a_wrong_file_of_topics_is_told_by_its_key(
    robot: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    bag, rules = robot
    for text, message in (
        ('imu/data_row: /x\n', "'imu/data_row' is no name in a recording (did you mean imu/data_"),
        ('imu/mag: [1\n', 'line 2'),
        ('- a\n', 'expected lines such as'),
    ):
        rules.write_text(text)
        argv = ['fit', str(bag), '--topics', str(rules), '-o', str(tmp_path / 'm.yaml')]
        assert main(argv) == 2
        assert message in capsys.readouterr().err


def test_topics_can_be_renamed_or_left_out(device_bags: Path, tmp_path: Path) -> None:
    target = tmp_path / 'm.yaml'
    argv = ['fit', str(device_bags / 'dut1'), '-o', str(target)]
    assert main([*argv, '--topic', 'imu/mag:=']) == 0
    assert 'magnetometer' not in load_model(target).sensors
    assert main([*argv, '--topic', 'imu/mag']) == 2
    assert main([*argv, '--topic', 'imu/mag:=/nowhere']) == 2


@pytest.mark.parametrize('verb', ['apply', 'compare', 'diagnose', 'add', 'auto', 'orient'])
def test_a_model_of_another_device_is_refused(
    verb: str, device_bags: Path, dut1_model: Path, tmp_path: Path, capsys
) -> None:
    target = ['-o', str(tmp_path / 'out')] if verb in {'apply', 'add', 'auto'} else []
    effect = ['thermal_lag'] if verb == 'add' else []
    argv = [verb, *effect, str(device_bags / 'dut2'), '--model', str(dut1_model), *target]
    assert main(argv) == 2
    (line,) = (text for text in capsys.readouterr().err.splitlines() if 'model' in text)
    assert 'the model is of dut1, the data of dut2; fit a model of that device' in line
    assert not (tmp_path / 'out').exists()
