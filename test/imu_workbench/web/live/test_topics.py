# SPDX-License-Identifier: Apache-2.0
"""Devices and roles are found under namespaces and remaps, with and without names that help."""

import pytest
from imu_recording.logging_contract import IMU, MAGNETIC_FIELD, STRING, TEMPERATURE
from imu_workbench.web.live.topics import Topic, assign, choices, concerns, namespaces


def device(namespace: str) -> list[Topic]:
    """What the nodes of one board publish by default."""
    driver, comp = f'{namespace}/imu_driver', f'{namespace}/thermal_comp'
    return [
        Topic(f'{namespace}/imu/data_raw', IMU, (driver,)),
        Topic(f'{namespace}/imu/mag', MAGNETIC_FIELD, (driver,)),
        Topic(f'{namespace}/imu/temperature', TEMPERATURE, (driver,)),
        Topic(f'{namespace}/imu_compensated/data_raw', IMU, (comp,)),
        Topic(f'{namespace}/imu_compensated/mag', MAGNETIC_FIELD, (comp,)),
        Topic(f'{namespace}/imu/data_ahrs', IMU, (f'{namespace}/ahrs_filter',)),
        Topic(f'{namespace}/imu/data_complementary', IMU, (f'{namespace}/complementary_filter',)),
    ]


CHAMBER = [
    Topic('/chamber/temperature', TEMPERATURE, ('/chamber_profile',)),
    Topic('/chamber/setpoint', TEMPERATURE, ('/chamber_profile',)),
    Topic('/chamber/phase', STRING, ('/chamber_profile',), latched=True),
]


@pytest.mark.parametrize('namespace', ['', '/dut1', '/robot/left'])
def test_the_usual_names_are_found_in_any_namespace(namespace: str) -> None:
    topics = device(namespace) + CHAMBER
    assert namespaces(topics) == [namespace]
    found = assign(topics, namespace)
    assert found['raw'] == f'{namespace}/imu/data_raw'
    assert found['compensated_field'] == f'{namespace}/imu_compensated/mag'
    assert found['ahrs'] == f'{namespace}/imu/data_ahrs'
    assert found['air'] == '/chamber/temperature'
    assert found['phase'] == '/chamber/phase'


def test_boards_side_by_side_stay_apart() -> None:
    topics = device('/dut1') + device('/dut2') + CHAMBER
    assert namespaces(topics) == ['/dut1', '/dut2']
    for namespace in ('/dut1', '/dut2'):
        own = {name for role, name in assign(topics, namespace).items() if role != 'air'}
        assert all(name.startswith((namespace, '/chamber')) for name in own)


def test_a_remapped_drop_in_is_seen_by_who_publishes() -> None:
    """The compensated stream stands where everybody looks for the raw one."""
    topics = [
        Topic('/imu/uncompensated', IMU, ('/imu_driver',)),
        Topic('/imu/data_raw', IMU, ('/thermal_comp',)),
        Topic('/attitude', IMU, ('/ahrs_filter',)),
        Topic('/imu/temperature', TEMPERATURE, ('/imu_driver',)),
    ]
    found = assign(topics, '')
    assert found['raw'] == '/imu/uncompensated'
    assert found['compensated'] == '/imu/data_raw'
    assert found['ahrs'] == '/attitude'
    assert found['temperature'] == '/imu/temperature'


def test_a_played_bag_is_found_by_name() -> None:
    topics = [Topic(t.name, t.message_type, ('/rosbag2_player',)) for t in device('/dut3')]
    assert namespaces(topics) == ['/dut3']
    found = assign(topics, '/dut3')
    assert (found['raw'], found['compensated']) == (
        '/dut3/imu/data_raw', '/dut3/imu_compensated/data_raw',
    )  # fmt: skip


def test_a_foreign_driver_under_another_name_is_offered_and_can_be_picked() -> None:
    topics = [Topic('/camera/imu', IMU, ('/camera/realsense',))]
    assert namespaces(topics) == ['/camera']
    assert assign(topics, '/camera') == {}
    assert choices(topics, 'raw') == ['/camera/imu']
    assert assign(topics, '/camera', {'raw': '/camera/imu'}) == {'raw': '/camera/imu'}


def test_a_chamber_within_the_namespace_is_preferred() -> None:
    own = Topic('/dut1/chamber/temperature', TEMPERATURE, ('/dut1/chamber_profile',))
    assert assign([*device('/dut1'), *CHAMBER, own], '/dut1')['air'] == own.name


def test_the_type_must_fit() -> None:
    topics = [Topic('/imu/mag', TEMPERATURE, ('/odd',)), *device('/a')]
    assert 'raw_field' not in assign(topics, '')


def test_diagnostics_of_other_devices_are_left_out() -> None:
    assert concerns('imu_driver', '', ['/dut2'])
    assert not concerns('dut2/imu_driver', '', ['/dut2'])
