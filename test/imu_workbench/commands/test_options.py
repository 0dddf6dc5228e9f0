# SPDX-License-Identifier: Apache-2.0
"""One device of several is chosen by its namespace or by its topics; a noise by its chip."""

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_recording.user_error import UserError
from imu_workbench.commands.options import noise_reference, read_devices

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
