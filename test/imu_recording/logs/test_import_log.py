# SPDX-License-Identifier: Apache-2.0
"""Logs of the simulated device, written and read back; real ones; and damaged ones."""

from __future__ import annotations

import signal
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_recording.logs.flight_log import LogError
from imu_recording.logs.import_log import import_log, is_log
from log_writers import dataflash_bytes, ulog_bytes

from imu_recording import ImuRecording, read_bag

WRITERS = {'ulg': ulog_bytes, 'bin': dataflash_bytes}
Writer = Callable[..., bytes]
MAGNETIC_STEP = {'ulg': 1e-11, 'bin': 1e-7}
"""Resolution of the magnetic field in each format [T]."""
PRESSURE = {'ulg': 101_325.0, 'bin': 1e5}
"""What the barometer has in each [Pa]; PX4 writes hPa or, later, Pa."""


@pytest.fixture(scope='module')
def devices(bags: Path) -> list[ImuRecording]:
    """Two simulated devices, a sample every half minute."""
    return [read_bag(bags / f'{name}_z').rows(slice(0, None, 15)) for name in ('dut1', 'dut2')]


def read(folder: Path, data: bytes, suffix: str) -> list[ImuRecording]:
    path = folder / f'flight.{suffix}'
    path.write_bytes(data)
    assert is_log(path)
    return [imu.recording for imu in import_log(path)]


@pytest.mark.parametrize('suffix', WRITERS)
def test_log_reads_back(suffix: str, devices: Sequence[ImuRecording], tmp_path: Path) -> None:
    found = read(tmp_path, WRITERS[suffix](devices), suffix)
    assert len(found) == 2
    for k, (device, recording) in enumerate(zip(devices, found, strict=True)):
        assert len(recording) == len(device)
        np.testing.assert_allclose(recording.time, device.time, atol=2e-6)
        assert recording.stamp[0] == 5_000_000_000  # on the clock that starts at power-on
        for field in ('angular_velocity', 'linear_acceleration', 'temperature'):
            expected = getattr(device, field)
            np.testing.assert_allclose(getattr(recording, field), expected, rtol=1e-6, atol=1e-9)
        seen = np.isfinite(device.magnetic_field).all(axis=1)
        np.testing.assert_allclose(
            recording.magnetic_field[seen],
            device.magnetic_field[seen],
            atol=MAGNETIC_STEP[suffix],
        )
        assert recording.device.endswith(f'_imu{k}')
        assert recording.up_axis == '+z'
    board, expected = found[0].device_temperature, devices[0].device_temperature
    assert board is not None
    assert expected is not None
    known = np.isfinite(expected)
    np.testing.assert_allclose(board[known], expected[known], atol=6e-3)
    pressure = found[0].pressure
    assert pressure is not None
    assert set(pressure.tolist()) == {PRESSURE[suffix]}


@pytest.mark.parametrize('suffix', WRITERS)
def test_parameters_and_hardware_come_along(
    suffix: str, devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    path = tmp_path / f'flight.{suffix}'
    parameters = {'TC_A_ENABLE': 0.0, 'INS_ACC2_ID': 2753028.0}
    path.write_bytes(WRITERS[suffix](devices, parameters=parameters))
    metadata = import_log(path)[1].metadata
    assert '"INS_ACC2_ID": 2753028.0' in metadata['log_parameters']
    expected = {'ulg': '"gyroscope_id": "1010"', 'bin': '"accelerometer_id": "2753028"'}
    assert expected[suffix] in metadata['log_hardware']
    names = {'ulg': '"ver_hw": "SIMULATED"', 'bin': 'SimBoard 00280030 3133510D 38363035'}
    assert names[suffix] in metadata['log_hardware']


def test_an_accelerometer_with_other_times_is_interpolated(
    devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    data = ulog_bytes(devices[:1], accelerometer_delay=7_000_000)
    found = read(tmp_path, data, 'ulg')[0]
    assert len(found) == len(devices[0]) - 1  # before its first sample nothing is known
    share = 7.0 / 30.0
    force = devices[0].linear_acceleration
    expected = share * force[:-1] + (1.0 - share) * force[1:]
    step = np.diff(devices[0].stamp)
    even = np.abs(step[1:] - 30e9) < 1e8
    np.testing.assert_allclose(
        found.linear_acceleration[:-1][even], expected[:-1][even], atol=0.02
    )
    assert any('interpolated' in note for note in found.notes)


def test_ardupilots_own_calibration_is_taken_out_again(
    devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    parameters = {'INS_TCAL1_ENABLE': 1, 'INS_TCAL1_TMIN': 0, 'INS_TCAL1_TMAX': 45}
    parameters |= {'INS_ACC1_CALTEMP': 25, 'INS_TCAL1_ACC1_X': 3000, 'INS_TCAL1_ACC2_X': 40}
    device = devices[0]
    t = np.clip(device.temperature, 0.0, 45.0) - 35.0
    subtracted = 3e-3 * (t + 10.0) + 40e-6 * (t**2 - 100.0)
    corrected = device.linear_acceleration.copy()
    corrected[:, 0] -= subtracted
    logged = replace(device, linear_acceleration=corrected)
    found = read(tmp_path, dataflash_bytes([logged], parameters=parameters), 'bin')[0]
    np.testing.assert_allclose(found.linear_acceleration, device.linear_acceleration, atol=1e-5)
    assert any('calibration was on' in note for note in found.notes)


def test_the_orientation_of_the_board_is_turned_back(
    devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    """Yaw 90 (2): the x axis of the board points along the y axis of the vehicle."""
    turned = devices[0].linear_acceleration[:, [1, 0, 2]] * [-1.0, 1.0, 1.0]
    logged = replace(devices[0], linear_acceleration=turned)
    data = dataflash_bytes([logged], parameters={'AHRS_ORIENTATION': 2})
    found = read(tmp_path, data, 'bin')[0]
    expected = devices[0].linear_acceleration
    np.testing.assert_allclose(found.linear_acceleration, expected, atol=1e-5)
    with pytest.raises(LogError, match='AHRS_ORIENTATION 99'):
        read(tmp_path, dataflash_bytes(devices[:1], parameters={'AHRS_ORIENTATION': 99}), 'bin')


@pytest.mark.parametrize('suffix', WRITERS)
def test_a_clock_that_restarts_leaves_the_longer_flight(
    suffix: str, devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    long, short = devices[0].rows(slice(0, 900)), devices[0].rows(slice(900, 1100))
    after = ulog_bytes([short], data_alone=True) if suffix == 'ulg' else dataflash_bytes([short])
    found = read(tmp_path, WRITERS[suffix]([long]) + after, suffix)[0]
    assert len(found) == 900
    assert any('clock' in note or 'stretch' in note for note in found.notes), found.notes


@pytest.mark.parametrize('suffix', WRITERS)
def test_a_truncated_log_gives_what_it_holds(
    suffix: str, devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    data = WRITERS[suffix](devices)
    found = read(tmp_path, data[: len(data) // 2 + 7], suffix)
    assert 0.4 * len(devices[0]) < len(found[0]) < 0.6 * len(devices[0])
    if suffix == 'ulg':  # on flash chips the others end with what is no message
        assert any('cut off' in note for note in found[0].notes)
        assert not any('cut off' in note for note in read(tmp_path, data, suffix)[0].notes)
    n = len(found[0])
    expected = devices[0].linear_acceleration[:n]
    np.testing.assert_allclose(found[0].linear_acceleration, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize('suffix', WRITERS)
def test_damage_is_an_exclusion_or_one_message(
    suffix: str, seed: int, devices: Sequence[ImuRecording], tmp_path: Path, capsys
) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray(WRITERS[suffix]([device.rows(slice(0, 200)) for device in devices]))
    for place in rng.integers(20, len(data), 3 + 40 * seed).tolist():
        data[place] = int(rng.integers(256))
    path = tmp_path / f'flight.{suffix}'
    path.write_bytes(data)
    try:
        said = ''
        lengths = [len(imu.recording) for imu in import_log(path)]
    except LogError as error:
        said, lengths = str(error), []
    assert all(length > 1 for length in lengths)
    assert lengths or (said.startswith(str(path)) and '\n' not in said)
    assert capsys.readouterr() == ('', '')  # the parsers' own words are not for the user


BAD = {
    'nothing': (b'', 'neither'),
    'text': (b'time,ax,ay\n1,2,3\n', 'neither'),
    'a header alone': (b'ULog\x01\x12\x35\x01' + bytes(8), 'no sensor_accel'),
    'another version': (b'ULog\x01\x12\x35\x07' + bytes(8), 'version 7'),
    'half a header': (b'ULog\x01\x12\x35\x01' + bytes(2), 'damaged'),
    'two bytes': (b'\xa3\x95', 'damaged|no IMU'),
    'no messages': (b'\xa3\x95\x80' + bytes(600), 'damaged|no IMU'),
}


@pytest.mark.parametrize('name', BAD)
def test_what_is_no_log_is_refused(name: str, tmp_path: Path) -> None:
    data, reason = BAD[name]
    path = tmp_path / 'log'
    path.write_bytes(data)
    with pytest.raises(LogError, match=reason):
        import_log(path)


def test_the_parameter_that_enables_what_is_missing_is_named(
    devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    cold = replace(devices[0], temperature=np.full(len(devices[0]), np.nan))
    with pytest.raises(LogError, match=r'no IMU has a temperature.*SDLOG_PROFILE'):
        read(tmp_path, ulog_bytes([cold]), 'ulg')
    with pytest.raises(LogError, match='no IMU has a temperature'):
        read(tmp_path, dataflash_bytes(devices, without_temperature=True), 'bin')
    with pytest.raises(LogError, match='LOG_BITMASK'):
        read(tmp_path, dataflash_bytes([]), 'bin')
    one = read(tmp_path, ulog_bytes([devices[1], cold]), 'ulg')
    assert [recording.device[-4:] for recording in one] == ['imu0']
    assert any('left out, no temperature: IMU 1' in note for note in one[0].notes)


@pytest.mark.shared_data
def test_real_logs(shared: Path) -> None:
    """Values as pyulog's own ulog2csv shows them; chips are paired by their device IDs."""
    folder = shared / 'data' / 'px4_logs'
    three = [imu.recording for imu in import_log(folder / 'pyulog_sample_log_small.ulg')]
    assert [len(recording) for recording in three] == [6, 6, 6]
    warmth = [float(recording.temperature[0]) for recording in three]
    np.testing.assert_allclose(warmth, [40.02537, 28.246023, 29.626112], rtol=1e-6)
    assert {recording.up_axis for recording in three} == {'-z'}
    assert np.isnan(three[2].magnetic_field).all()
    two = import_log(folder / 'robologs_test.ulg')
    assert [imu.name for imu in two] == ['imu0', 'imu1']
    assert '"gyroscope_id": "4325386"' in two[1].metadata['log_hardware']
    assert any('temperature' in note for note in two[1].recording.notes)
    assert set(two[1].recording.temperature) == {32.0}


def test_a_blackbox_log_is_refused_with_the_reason(tmp_path: Path) -> None:
    path = tmp_path / 'LOG00001.BFL'
    path.write_bytes(
        b'H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n'
    )
    assert is_log(path)
    with pytest.raises(LogError, match='Betaflight writes none of its IMU into it'):
        import_log(path)


@pytest.mark.parametrize('suffix', WRITERS)
def test_stamps_are_dates_where_gps_tells_them(
    suffix: str, devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    started = 1_767_225_600.0  # 2026-01-01
    (recording,) = read(tmp_path, WRITERS[suffix](devices[:1], power_on=started), suffix)
    assert recording.stamp[0] == pytest.approx((started + 5.0) * 1e9, abs=2e6)
    assert np.array_equal(recording.stamp, recording.temperature_stamp)
    np.testing.assert_allclose(recording.time, devices[0].time, atol=2e-6)
    assert 'stamps are dates, by GPS' in recording.notes
    # A receiver that never had a fix tells nothing.
    (silent,) = read(tmp_path, WRITERS[suffix](devices[:1], power_on=1e9), suffix)
    assert silent.stamp[0] == 5_000_000_000


def test_a_torn_definition_longer_than_the_log_ends(
    devices: Sequence[ImuRecording], tmp_path: Path
) -> None:
    data = ulog_bytes(devices[:1])[:4000]
    path = tmp_path / 'torn.ulg'
    path.write_bytes(data[:16] + b'\x00\x90\x00' + data[16:])

    def late(*_: object) -> None:
        raise AssertionError

    previous = signal.signal(signal.SIGALRM, late)
    signal.alarm(20)
    try:
        with pytest.raises(LogError, match='no sensor_accel'):
            import_log(path)
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)


@pytest.mark.parametrize(
    ('name', 'content', 'said'),
    [
        ('a.ulg', b'hello,world\n' * 9, 'no PX4 ULog .its first bytes are not those of one.'),
        ('a.BIN', b'', 'no ArduPilot DataFlash log .it is empty.'),
        ('a.bbl', b'\x00' * 9, 'no Blackbox log .its first bytes are not those of one.'),
    ],
)
def test_a_file_that_is_only_named_like_a_log_is_refused(
    tmp_path: Path, name: str, content: bytes, said: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(LogError, match=f'{said}; copy it again from the board'):
        is_log(path)
    other = path.rename(tmp_path / 'a.csv')
    assert not is_log(other)
