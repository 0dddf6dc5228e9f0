# SPDX-License-Identifier: Apache-2.0
"""PX4's ULog: the topics sensor_accel, sensor_gyro, sensor_mag and sensor_baro of every instance.

They hold what the drivers measured, before any calibration and thermal compensation of PX4.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.logs.flight_log import (
    MOST_KEPT_ROWS,
    WHOLE_FILE_BYTES,
    FlightLog,
    LogError,
    LoggedImu,
    Series,
    check_columns,
    with_temperature,
)
from imu_recording.logs.gps_time import power_on
from imu_recording.logs.ulog_stream import Topic, ends_within_a_message, stream_topics
from imu_recording.recording import TESLA_PER_GAUSS, FloatArray

MAGIC = b'ULog\x01\x12\x35'
KNOWN_VERSIONS = (0, 1)
COLUMNS_OF_TOPIC = {
    'sensor_accel': ('x', 'y', 'z', 'temperature'),
    'sensor_gyro': ('x', 'y', 'z'),
    'sensor_mag': ('x', 'y', 'z'),
    'sensor_baro': ('temperature',),
}
"""Topics that are read, and what they have to hold beside the time."""
TOPICS = tuple(COLUMNS_OF_TOPIC)
CLOCK_COLUMNS = {'sensor_gps': ('time_utc_usec',), 'vehicle_gps_position': ('time_utc_usec',)}
"""Topics that may tell the date."""
CUT_OFF_NOTE = 'the log was cut off: it ends within a message; what follows is missing'
LARGEST_PRESSURE_HPA = 2000.0
"""Pressure up to which sensor_baro is in hPa, as before PX4 1.14; since then it is in Pa."""
LOGGING_ADVICE = (
    'log every sensor at full rate: SDLOG_PROFILE bit 2 (thermal calibration), SDLOG_MODE 2 (from '
    'power-on)'
)
HARDWARE_KEYS = ('ver_hw', 'ver_hw_subtype', 'ver_sw', 'ver_sw_branch', 'sys_mcu', 'sys_uuid')
"""What a log says of board and firmware."""


def is_ulog(start: bytes) -> bool:
    """Tell from its first bytes whether a file is a ULog."""
    return start.startswith(MAGIC)


def read_ulog(
    path: Path, *, whole_below: int = WHOLE_FILE_BYTES, most_rows: int = MOST_KEPT_ROWS
) -> FlightLog:
    """Read a ULog; raise LogError where it is damaged beyond use, or lacks what is needed.

    A file of `whole_below` bytes and more is read piece by piece; a topic with more than
    `most_rows` samples is averaged to at most that many.
    """
    long = path.stat().st_size >= whole_below
    log, printed = _opened(path, header_only=long)
    data, notes = _streamed(path, log, most_rows) if long else _held(path, log, printed)
    zero = _power_on(data)
    data = {key: item for key, item in data.items() if key[0] in COLUMNS_OF_TOPIC}
    for (topic, instance), item in data.items():
        check_columns(path, f'{topic} {instance}', item, ('timestamp', *COLUMNS_OF_TOPIC[topic]))
    imus = _imus(path, data)
    known = with_temperature(path, imus, f'its sensors report none in this log; {LOGGING_ADVICE}')
    without = [f'IMU {imu.number}' for imu in imus if imu not in known]
    if without:
        notes.append(f'left out, no temperature: {", ".join(without)}')
    info = log.msg_info_dict
    return FlightLog(
        vehicle=f'px4_{info.get("sys_uuid") or path.stem}',
        imus=known,
        parameters={str(k): float(v) for k, v in log.initial_parameters.items()},
        hardware={key: str(info[key]) for key in HARDWARE_KEYS if key in info},
        power_on=zero,
        path=str(path),
        notes=tuple(notes),
    )


def _power_on(data: Mapping[Topic, Mapping[str, Any]]) -> int | None:
    """Return when the log's clock was zero by the first receiver that tells."""
    for (topic, _), item in sorted(data.items(), key=lambda one: one[0]):
        if (
            topic not in CLOCK_COLUMNS
            or not {'timestamp', 'time_utc_usec', 'fix_type'} <= item.keys()
        ):
            continue
        time = np.asarray(item['timestamp']).astype(np.int64) * 1000
        zero = power_on(time, 1e-6 * np.asarray(item['time_utc_usec'], float), item['fix_type'])
        if zero is not None:
            return zero
    return None


def _held(path: Path, log: Any, printed: str) -> tuple[dict[Topic, Mapping[str, Any]], list[str]]:
    """Return the topics of a log that was read as a whole, and notes."""
    damaged = log.file_corruption or 'corruption' in printed
    lost = sum(dropout.duration for dropout in log.dropouts)
    data = {(item.name, item.multi_id): item.data for item in log.data_list}
    notes = _damage_notes(damaged=damaged, dropouts=len(log.dropouts), lost_ms=lost)
    return data, [*notes, *([CUT_OFF_NOTE] if ends_within_a_message(path) else [])]


def _streamed(
    path: Path, log: Any, most_rows: int
) -> tuple[dict[Topic, Mapping[str, Any]], list[str]]:
    """Return the topics of a long log, averaged, and notes."""
    further = ('temperature', 'pressure', 'device_id')
    columns = {name: (*COLUMNS_OF_TOPIC[name], *further) for name in TOPICS}
    columns |= {name: (*needed, 'fix_type') for name, needed in CLOCK_COLUMNS.items()}
    known = {name: tuple(dict.fromkeys(needed)) for name, needed in columns.items()}
    try:
        found = stream_topics(path, log.message_formats, known, most_rows)
    except (KeyError, TypeError, ValueError) as error:
        raise LogError(
            f'{path}: damaged, cannot be read ({type(error).__name__}: {error})'
        ) from None
    notes = _damage_notes(
        damaged=found.damaged > 0, dropouts=found.dropouts, lost_ms=found.dropout_ms
    )
    if found.cut:
        notes.append(CUT_OFF_NOTE)
    if found.averaged > 1:
        notes.append(f'a long log: rows are means of {found.averaged} samples')
    return dict(found.columns), notes


def _damage_notes(*, damaged: bool, dropouts: int, lost_ms: int) -> list[str]:
    notes = []
    if damaged:
        notes.append('the log is damaged: messages that could not be read are left out')
    if dropouts:
        notes.append(f'{dropouts} dropouts of the logger, {lost_ms} ms in all')
    return notes


def _opened(path: Path, *, header_only: bool) -> tuple[Any, str]:
    """Return the parsed log and what the parser printed."""
    try:
        from pyulog import ULog
    except ImportError:
        raise LogError(f'{path}: reading a ULog needs pyulog (pip install pyulog)') from None
    with path.open('rb') as stream:
        version = stream.read(8)[-1]
    if version not in KNOWN_VERSIONS:
        raise LogError(f'{path}: ULog of version {version}; versions 0 and 1 are read')

    class Parser(ULog):  # type: ignore[misc]
        """pyulog, ended where a definition longer than its file would make it loop for ever."""

        _furthest: int | None = None

        def _read_file_definitions(self) -> None:
            self._furthest = 0
            super()._read_file_definitions()
            self._furthest = None

        def _check_packet_corruption(self, header: Any) -> bool:
            damaged = bool(super()._check_packet_corruption(header))
            if damaged and self._furthest is not None:
                following = self._file_handle.tell() - 2 - header.msg_size
                if following <= self._furthest:
                    raise IndexError(following)  # pyulog ends the definitions here
                self._furthest = following
            return damaged

    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):
            topics = [*TOPICS, *CLOCK_COLUMNS]
            log = Parser(str(path), message_name_filter_list=topics, parse_header_only=header_only)
    except Exception as error:  # noqa: BLE001 (the parser raises whatever damage leads to)
        raise LogError(
            f'{path}: damaged, cannot be read ({type(error).__name__}: {error})'
        ) from None
    return log, printed.getvalue()


def _imus(path: Path, data: Mapping[tuple[str, int], Mapping[str, Any]]) -> list[LoggedImu]:
    """Return every accelerometer with its gyroscope: that of its chip, else of its instance."""
    instances = {topic: sorted(k for name, k in data if name == topic) for topic in TOPICS}
    accelerometers, gyroscopes = instances['sensor_accel'], instances['sensor_gyro']
    if not accelerometers or not gyroscopes:
        missing = 'sensor_accel' if not accelerometers else 'sensor_gyro'
        raise LogError(f'{path}: no {missing} in it; {LOGGING_ADVICE}')
    chip = {k: _device_id(data['sensor_gyro', k]) for k in gyroscopes}
    free = list(gyroscopes)
    pairs: dict[int, int] = {}
    for k in accelerometers:
        same = [g for g in free if chip[g] == _device_id(data['sensor_accel', k])]
        if same:
            pairs[k] = same[0]
            free.remove(same[0])
    for k in accelerometers:
        if k not in pairs and free:
            pairs[k] = k if k in free else free[0]
            free.remove(pairs[k])
    return [_imu(data, k, pairs[k]) for k in sorted(pairs)]


def _imu(
    data: Mapping[tuple[str, int], Mapping[str, Any]], number: int, gyroscope: int
) -> LoggedImu:
    force, rate = data['sensor_accel', number], data['sensor_gyro', gyroscope]
    field = data.get(('sensor_mag', number))
    board = data.get(('sensor_baro', number), data.get(('sensor_baro', 0)))
    thermometer, notes = (rate, []) if _has_temperature(rate) else (force, [])
    if thermometer is force and _has_temperature(force):
        notes.append('the gyroscope reports no temperature: that of the accelerometer is taken')
    ids = {'accelerometer_id': force, 'gyroscope_id': rate, 'magnetometer_id': field}
    return LoggedImu(
        number=number,
        gyroscope=_series(rate, ('x', 'y', 'z')),
        accelerometer=_series(force, ('x', 'y', 'z')),
        temperature=_series(thermometer, ('temperature',)),
        magnetometer=None
        if field is None
        else _series(field, ('x', 'y', 'z'), factor=TESLA_PER_GAUSS),
        barometer_temperature=None if board is None else _series(board, ('temperature',)),
        pressure=_pressure(board),
        hardware={name: str(_device_id(item)) for name, item in ids.items() if item is not None},
        notes=tuple(notes),
    )


def _series(item: Mapping[str, Any], names: tuple[str, ...], factor: float = 1.0) -> Series:
    """Return columns at the times of measurement; older logs have only those of publication."""
    time = np.asarray(item.get('timestamp_sample', item['timestamp']))
    if time.dtype.kind not in 'iu' or not time.any():
        time = np.asarray(item['timestamp'])
    values: FloatArray = np.stack([np.asarray(item[n], float) for n in names], axis=1) * factor
    return Series(time.astype(np.int64) * 1000, values)


def _pressure(board: Mapping[str, Any] | None) -> Series | None:
    if board is None or 'pressure' not in board:
        return None
    series = _series(board, ('pressure',))
    known = series.values[np.isfinite(series.values)]
    hectopascal = len(known) > 0 and float(np.median(known)) < LARGEST_PRESSURE_HPA
    return Series(series.time, series.values * 100.0) if hectopascal else series


def _has_temperature(item: Mapping[str, Any]) -> bool:
    return 'temperature' in item and bool(np.isfinite(item['temperature']).any())


def _device_id(item: Mapping[str, Any]) -> int:
    return int(np.median(item['device_id'])) if 'device_id' in item else 0
