# SPDX-License-Identifier: Apache-2.0
"""Types of installed packages are found with all their parts; a bag's own definition counts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_recording.bags.decoding.message_types import (
    DecodeError,
    definition_of,
    hash_of,
    installed_types,
    message_name,
    message_text,
    standard_types,
    types_of,
)
from imu_recording.logging_contract import STRING, TEMPERATURE
from imu_recording.recorder.bag_recorder import BagRecorder
from imu_recording.ros.message_cdr import message_class
from rosbags.highlevel import AnyReader

PROBE = 'laboratory_msgs/msg/Probe'
FILES = {
    'Probe': 'uint8 OPEN=1\nstd_msgs/Header header\nChannel[] channels\nfloat64[9] covariance\n',
    'Channel': 'string name\nfloat32 value 0.5\n',
}


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A package with two message types, as `colcon build` leaves it."""
    folder = tmp_path / 'install' / 'share' / 'laboratory_msgs' / 'msg'
    folder.mkdir(parents=True)
    for name, text in FILES.items():
        (folder / f'{name}.msg').write_text(text)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'install'))
    for known in (installed_types, definition_of, hash_of):
        known.cache_clear()
    yield
    for known in (installed_types, definition_of, hash_of):
        known.cache_clear()


def test_a_recorded_custom_type_can_be_decoded_by_others(installed: Any, tmp_path: Path) -> None:
    types = installed_types(PROBE)
    assert types is not None
    channel, header = (
        types.types[n] for n in ('laboratory_msgs/msg/Channel', 'std_msgs/msg/Header')
    )
    time = types.types['builtin_interfaces/msg/Time']
    probe = types.types[PROBE](
        header=header(stamp=time(sec=1, nanosec=2), frame_id='rack'),
        channels=[channel(name='pt100', value=21.5)],
        covariance=np.arange(9.0),
    )
    recorder = BagRecorder(tmp_path / 'run', sync=False)
    recorder.record('/probe', PROBE, types.serialize_cdr(probe, PROBE), 5)
    recorder.close()
    with AnyReader([tmp_path / 'run']) as reader:
        (connection,) = reader.connections
        assert 'MSG: laboratory_msgs/Channel' in connection.msgdef.data
        assert 'uint8 OPEN=1' in connection.msgdef.data
        (read,) = [reader.deserialize(data, PROBE) for _, _, data in reader.messages()]
    assert read.channels[0].name == 'pt100'
    assert read.covariance.tolist() == list(range(9))
    assert hash_of(PROBE) in (tmp_path / 'run' / 'metadata.yaml').read_text()
    assert hash_of(PROBE).startswith('RIHS01_')


def test_a_type_that_is_nowhere_has_no_definition(installed: Any) -> None:
    assert definition_of('nowhere_msgs/msg/Nothing') == ''


@pytest.mark.parametrize('name', ['sensor_msgs/msg/Imu', 'diagnostic_msgs/msg/DiagnosticArray'])
def test_a_class_without_its_file_tells_the_same_type(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')
    text = message_text(name)
    assert text is not None
    fields = message_class(name).get_fields_and_field_types()
    assert text.count('\n') == len(fields) == len(standard_types().fielddefs[name][1])
    assert message_name('sequence<uint8, 4>') == 'uint8[<=4]'


@pytest.mark.parametrize(
    'name', ['', 'Imu', 'a/b', 'sensor_msgs/msg/Imu/x', '../x/msg/Y', '.x/msg/Y']
)
def test_what_is_no_type_is_looked_for_nowhere(name: str) -> None:
    assert message_text(name) is None
    assert definition_of(name) == ''


def test_a_bags_own_definition() -> None:
    standard = definition_of(TEMPERATURE)
    assert types_of(TEMPERATURE, standard) is standard_types()
    other = standard.replace('float64 variance', 'float32 variance')
    assert types_of(TEMPERATURE, other) is not standard_types()
    with pytest.raises(DecodeError, match=f'definition of {TEMPERATURE} is damaged'):
        types_of(TEMPERATURE, 'Header')
    assert hash_of(STRING).startswith('RIHS01_')
    assert definition_of('none_msgs/msg/Such') == hash_of('none_msgs/msg/Such') == ''
