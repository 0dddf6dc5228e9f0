# SPDX-License-Identifier: Apache-2.0
"""ArduPilot's DataFlash log: IMU, MAG, BARO and PARM messages.

IMU messages hold rates and forces after ArduPilot's temperature calibration and in the axes of the
vehicle: a calibration that was on is taken out again, the orientation of the board is turned back.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.logs.flight_log import (
    FlightLog,
    LogError,
    LoggedImu,
    Series,
    check_columns,
    with_temperature,
)
from imu_recording.recording import FloatArray

MAGIC = b'\xa3\x95'
TESLA_PER_MILLIGAUSS = 1e-7
WAY_OUT = 'log IMU messages: LOG_BITMASK bit 7 (IMU), LOG_DISARMED 1 (before take-off)'
BOARD_ID = re.compile(r'^(\S+) ([0-9A-F]{8}) ([0-9A-F]{8}) ([0-9A-F]{8})$')
"""The message that names board and serial number."""
FIRMWARE = re.compile(r'^(Ardu|APM|Blimp|AntennaTracker)')
REFERENCE_TEMPERATURE = 35.0
"""Of INS_TCALn_… [°C]."""
SCALE = 1e-6

GYROSCOPE, ACCELEROMETER, MAGNETOMETER = (
    tuple(f'{name}{axis}' for axis in 'XYZ') for name in ('Gyr', 'Acc', 'Mag')
)
PADDING = 528
"""Bytes at the end of a log that are no message: logs on flash chips end with a page."""

ROWS_AT_A_TIME = 100_000
"""Messages that are gathered at a time: where their bytes stand takes eight times their size."""

Columns = Mapping[str, Any]


def is_dataflash(start: bytes) -> bool:
    """Tell from its first bytes whether a file is a DataFlash log."""
    return start.startswith(MAGIC)


def read_dataflash(path: Path) -> FlightLog:
    """Read a DataFlash log; raise LogError where it is damaged beyond use, or lacks IMUs."""
    reader = _opened(path)
    parameters = _parameters(_table(path, reader, 'PARM', 'Name', 'Value'))
    texts = [str(text) for text in _table(path, reader, 'MSG', 'Message').get('Message', ())]
    notes = []
    lost = _bytes_outside_messages(reader)
    if lost > PADDING:
        notes.append(f'the log is damaged: {lost} bytes that are no message are left out')
    imus = _imus(path, reader, parameters)
    known = with_temperature(
        path, imus, 'this firmware logs none: update it, T is in IMU messages'
    )
    board = next(filter(None, map(BOARD_ID.match, texts)), None)
    vehicle = ''.join(board.groups()[1:]) if board else path.stem
    hardware = {'firmware': next((text for text in texts if FIRMWARE.match(text)), '')}
    if board:
        hardware['board'] = board.group(0)
    name = f'ardupilot_{vehicle}'
    return FlightLog(name, known, parameters, hardware, str(path), tuple(notes))


def _opened(path: Path) -> Any:
    """Return pymavlink's reader, which indexes the file."""
    try:
        from pymavlink import DFReader
    except ImportError:
        raise LogError(
            f'{path}: reading this log needs pymavlink (pip install pymavlink)'
        ) from None

    class Index(DFReader.DFReader_binary):  # type: ignore[misc]
        """The reader without its search for the time of day, which reads every message."""

        def init_clock(self) -> None:
            """Leave the clock as it is: since power-on."""

    try:
        with _silence():
            return Index(str(path))
    except Exception as error:  # noqa: BLE001 (the parser raises whatever damage leads to)
        reason = f'{type(error).__name__}: {error}'
        raise LogError(f'{path}: damaged, cannot be read ({reason})') from None


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Drop what the parser, compiled code in part, says of damage: a line per byte."""
    sys.stderr.flush()
    kept, said = os.dup(2), io.StringIO()
    try:
        with (
            Path(os.devnull).open('wb') as nothing,
            contextlib.redirect_stderr(said),
            contextlib.redirect_stdout(said),
        ):
            os.dup2(nothing.fileno(), 2)
            yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


def _bytes_outside_messages(reader: Any) -> int:
    lengths = {number: form.len for number, form in reader.formats.items()}
    read = sum(count * lengths.get(number, 0) for number, count in enumerate(reader.counts))
    return int(reader.data_len - read)


def _table(path: Path, reader: Any, name: str, *needed: str) -> dict[str, Any]:
    """Return all messages of a type as columns; none where there are no such messages.

    Raises LogError where the columns that are `needed`, or the time, are not among them.
    """
    number = reader.name_to_id.get(name)
    if number is None or not len(reader.offsets[number]):
        return {}
    form = reader.formats[number]
    items = _item_types(form.msg_struct)
    if len(items) != len(form.columns) or len(set(form.columns)) < len(form.columns):
        raise LogError(f'{path}: the definition of {name} messages is damaged')
    types = np.dtype(list(zip(form.columns, items, strict=True)))
    offsets = np.asarray(reader.offsets[number], np.int64) + 3
    offsets = offsets[offsets + types.itemsize <= reader.data_len]
    data = np.frombuffer(reader.data_map, np.uint8)
    rows = np.empty(len(offsets), types)
    for start in range(0, len(offsets), ROWS_AT_A_TIME):
        some = slice(start, start + ROWS_AT_A_TIME)
        places = offsets[some, None] + np.arange(types.itemsize)
        rows[some] = data[places].view(types)[:, 0]
    columns = {}
    for column, factor in zip(form.columns, form.msg_mults, strict=True):
        values = rows[column]
        if values.dtype.kind == 'S':
            columns[column] = [v.decode('ascii', 'replace') for v in values.tolist()]
        else:
            columns[column] = values if factor is None else values * factor
    check_columns(path, name, columns, ('TimeUS', *needed))
    return columns


def _item_types(layout: str) -> list[str]:
    """Return numpy's types of a struct layout.

    >>> _item_types('<QB16sf')
    ['<u8', 'u1', 'S16', '<f4']
    """
    known = {'Q': '<u8', 'q': '<i8', 'I': '<u4', 'i': '<i4', 'H': '<u2', 'h': '<i2', 'B': 'u1'}
    known |= {'b': 'i1', 'f': '<f4', 'd': '<f8', 'e': '<f2'}
    found = re.findall(r'(\d*)([a-zA-Z])', layout)
    return [f'S{count}' if kind == 's' else known[kind] for count, kind in found]


def _parameters(table: Columns) -> dict[str, float]:
    """Return the first value of each parameter: that at power-on."""
    names, values = table.get('Name', []), np.asarray(table.get('Value', ()), float)
    first: dict[str, float] = {}
    for name, value in zip(names, values.tolist(), strict=True):
        first.setdefault(name, value)
    return first


def _imus(path: Path, reader: Any, parameters: Mapping[str, float]) -> list[LoggedImu]:
    tables = dict(_instances(path, reader, 'IMU', *GYROSCOPE, *ACCELEROMETER))
    if not tables:
        raise LogError(f'{path}: no IMU messages in it; {WAY_OUT}')
    fields = dict(_instances(path, reader, 'MAG', *MAGNETOMETER))
    boards = dict(_instances(path, reader, 'BARO'))
    turn = _board_rotation(path, parameters)
    imus = []
    for number, table in tables.items():
        field, board = fields.get(number), boards.get(number, boards.get(0))
        notes = [] if turn is None else ['the orientation of the board is turned back']
        if field is not None:
            notes.append('the magnetometer has the offsets of the autopilot in it')
        temperature = np.asarray(table['T'], float) if 'T' in table else None
        vectors = {}
        for kind, names in (('ACC', ACCELEROMETER), ('GYR', GYROSCOPE)):
            values = _vector(table, names)
            if turn is not None:
                values = values @ turn
            if temperature is not None and parameters.get(f'INS_TCAL{number + 1}_ENABLE') == 1:
                values = values + _calibration(parameters, number, kind, temperature)
                notes.append("ArduPilot's temperature calibration was on: it is taken out again")
            vectors[kind] = values
        imus.append(
            LoggedImu(
                number=number,
                gyroscope=_series(table, vectors['GYR']),
                accelerometer=_series(table, vectors['ACC']),
                temperature=_series(
                    table,
                    np.full((len(vectors['ACC']), 1), np.nan)
                    if temperature is None
                    else temperature[:, None],
                ),
                magnetometer=None
                if field is None
                else _series(field, TESLA_PER_MILLIGAUSS * _vector(field, MAGNETOMETER)),
                barometer_temperature=None
                if board is None or 'Temp' not in board
                else _series(board, np.asarray(board['Temp'], float)[:, None]),
                hardware=_device_ids(parameters, number),
                notes=tuple(dict.fromkeys(notes)),
            )
        )
    return imus


def _instances(
    path: Path, reader: Any, name: str, *needed: str
) -> list[tuple[int, dict[str, Any]]]:
    """Return the messages of each instance: by their field I, or by a number in their name."""
    table = _table(path, reader, name, *needed)
    if 'I' in table:
        instance = np.asarray(table['I'])
        return [
            (k, {n: np.asarray(v)[instance == k] for n, v in table.items()})
            for k in np.unique(instance).tolist()
        ]
    others = ((k, _table(path, reader, f'{name}{k + 1}', *needed)) for k in (1, 2))
    named = [(0, table), *others]
    return [(k, found) for k, found in named if found]


def _vector(table: Columns, names: Sequence[str]) -> FloatArray:
    return np.stack([np.asarray(table[name], float) for name in names], axis=1)


def _series(table: Columns, values: FloatArray) -> Series:
    return Series(np.asarray(table['TimeUS']).astype(np.int64) * 1000, values)


def _device_ids(parameters: Mapping[str, float], number: int) -> dict[str, str]:
    suffix = '' if number == 0 else str(number + 1)
    names = {'accelerometer_id': f'INS_ACC{suffix}_ID', 'gyroscope_id': f'INS_GYR{suffix}_ID'}
    return {key: f'{parameters[name]:.0f}' for key, name in names.items() if name in parameters}


def _board_rotation(path: Path, parameters: Mapping[str, float]) -> FloatArray | None:
    """Return (3, 3) R of board into vehicle axes, so that rows @ R are in the board's; or None."""
    number = int(parameters.get('AHRS_ORIENTATION', 0))
    if number == 0:
        return None
    from pymavlink.rotmat import Vector3

    axes = [Vector3(*axis).rotate_by_id(number) for axis in np.eye(3).tolist()]
    if any(axis is None for axis in axes):
        raise LogError(f'{path}: AHRS_ORIENTATION {number} is not known')
    rotation: FloatArray = np.array([[axis.x, axis.y, axis.z] for axis in axes]).T
    return rotation


def _calibration(
    parameters: Mapping[str, float], number: int, kind: str, temperature: FloatArray
) -> FloatArray:
    """Return the (n, 3) that ArduPilot subtracted: its cubic at T less that at the calibration."""
    prefix = f'INS_TCAL{number + 1}'
    sensor = f'INS_{kind}{number + 1}'
    low, high = parameters.get(f'{prefix}_TMIN', 0.0), parameters.get(f'{prefix}_TMAX', 70.0)
    then = parameters.get(f'{sensor}_CALTEMP', REFERENCE_TEMPERATURE)
    total: FloatArray = np.zeros((len(temperature), 3))
    x, x0 = (
        np.clip(t, low, high) - REFERENCE_TEMPERATURE for t in (temperature, np.array([then]))
    )
    for k, axis in enumerate('XYZ'):
        for power in (1, 2, 3):
            factor = SCALE * parameters.get(f'{prefix}_{kind}{power}_{axis}', 0.0)
            total[:, k] += factor * (x**power - x0**power)
    return total
