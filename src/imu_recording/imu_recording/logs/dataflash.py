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
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from imu_recording.logs.dataflash_stream import (
    HEAD_BYTES,
    INSTANCE_COLUMN,
    TIME_COLUMN,
    MessageLayout,
    messages_at,
    stream_messages,
)
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
from imu_recording.logs.gps_time import power_on, unix_of_gps
from imu_recording.recording import FloatArray

MAGIC = b'\xa3\x95'
TESLA_PER_MILLIGAUSS = 1e-7
LOGGING_ADVICE = 'log IMU messages: LOG_BITMASK bit 7 (IMU), LOG_DISARMED 1 (before take-off)'
BOARD_ID_MESSAGE = re.compile(r'^(\S+) ([0-9A-F]{8}) ([0-9A-F]{8}) ([0-9A-F]{8})$')
"""The message that names board and serial number."""
FIRMWARE_MESSAGE = re.compile(r'^(Ardu|APM|Blimp|AntennaTracker)')
REFERENCE_TEMPERATURE_C = 35.0
"""Reference temperature of the calibration INS_TCALn_… [°C]."""
COEFFICIENT_SCALE = 1e-6
"""SI units per unit of a coefficient INS_TCALn_…."""

GYROSCOPE, ACCELEROMETER, MAGNETOMETER = (
    tuple(f'{name}{axis}' for axis in 'XYZ') for name in ('Gyr', 'Acc', 'Mag')
)
PADDING_BYTES = 528
"""Most bytes at the end of a log that are no message: logs on flash chips end with a page."""

ROWS_PER_BLOCK = 100_000
"""Messages that are gathered at a time: the places of their bytes take eight times their size."""

DEFINITIONS_BYTES = 1 << 24
"""Size of a log's beginning that defines its messages."""
UNAVERAGED_MESSAGES = frozenset({'PARM', 'MSG', 'GPS'})
"""Messages of a long log that are read one by one."""
AVERAGED_MESSAGES = {
    f'{name}{number}': columns
    for name, columns in (
        ('IMU', (*GYROSCOPE, *ACCELEROMETER, 'T')),
        ('MAG', MAGNETOMETER),
        ('BARO', ('Temp', 'Press')),
    )
    for number in ('', '2', '3')
}
"""Messages of a long log that are averaged, with the columns that are read."""

Columns = Mapping[str, Any]
Tables = Callable[..., dict[str, Any]]
"""Columns of the messages of a name, {} where there are none; LogError where one is missing."""


def is_dataflash(start: bytes) -> bool:
    """Tell from its first bytes whether a file is a DataFlash log."""
    return start.startswith(MAGIC)


def read_dataflash(
    path: Path, *, whole_below: int = WHOLE_FILE_BYTES, most_rows: int = MOST_KEPT_ROWS
) -> FlightLog:
    """Read a DataFlash log; raise LogError where it is damaged beyond use, or lacks IMUs.

    A file of `whole_below` bytes and more is read piece by piece; messages of a kind with more
    than `most_rows` are averaged to at most that many.
    """
    long = path.stat().st_size >= whole_below
    tables, lost, notes = _streamed(path, most_rows) if long else _held(path)
    parameters = _parameters(tables('PARM', 'Name', 'Value'))
    texts = [str(text) for text in tables('MSG', 'Message').get('Message', ())]
    if lost > PADDING_BYTES:
        notes.append(f'the log is damaged: {lost} bytes that are no message are left out')
    imus = _imus(path, tables, parameters)
    known = with_temperature(
        path, imus, 'this firmware logs none: update it, T is in IMU messages'
    )
    board = next(filter(None, map(BOARD_ID_MESSAGE.match, texts)), None)
    vehicle = ''.join(board.groups()[1:]) if board else path.stem
    hardware = {'firmware': next((text for text in texts if FIRMWARE_MESSAGE.match(text)), '')}
    if board:
        hardware['board'] = board.group(0)
    return FlightLog(
        vehicle=f'ardupilot_{vehicle}',
        imus=known,
        parameters=parameters,
        hardware=hardware,
        power_on=_power_on(tables),
        path=str(path),
        notes=tuple(notes),
    )


def _power_on(tables: Tables) -> int | None:
    table = tables('GPS')
    if not {'Status', 'GMS', 'GWk'} <= table.keys():
        return None
    time = np.asarray(table[TIME_COLUMN]).astype(np.int64) * 1000
    return power_on(time, unix_of_gps(table['GWk'], table['GMS']), table['Status'])


def _held(path: Path) -> tuple[Tables, int, list[str]]:
    """Return the messages of a log that is read as a whole, bytes that are none, and notes."""
    reader = _opened(path)
    return partial(_indexed_messages, path, reader), _bytes_outside_messages(reader), []


def _indexed_messages(path: Path, reader: Any, name: str, *needed: str) -> dict[str, Any]:
    """Return the columns of the messages of a name, from the places that the reader has found."""
    number = reader.name_to_id.get(name)
    if number is None or not len(reader.offsets[number]):
        return {}
    layout = _layout(path, reader, name)
    size = layout.content.itemsize
    offsets = np.asarray(reader.offsets[number], np.int64) + HEAD_BYTES
    offsets = offsets[offsets + size <= reader.data_len]
    data = np.frombuffer(reader.data_map, np.uint8)
    rows = np.empty(len(offsets), layout.content)
    for start in range(0, len(offsets), ROWS_PER_BLOCK):
        some = slice(start, start + ROWS_PER_BLOCK)
        rows[some] = messages_at(data, offsets[some], layout)
    columns = _columns(rows, layout)
    check_columns(path, name, columns, (TIME_COLUMN, *needed))
    return columns


def _streamed(path: Path, most_rows: int) -> tuple[Tables, int, list[str]]:
    """Return the messages of a long log, samples averaged; its beginning defines the messages."""
    with tempfile.NamedTemporaryFile(suffix=path.suffix) as beginning:
        with path.open('rb') as stream:
            beginning.write(stream.read(DEFINITIONS_BYTES))
        beginning.flush()
        reader = _opened(Path(beginning.name), path)
    lengths = np.zeros(256, np.int64)
    lengths[list(reader.formats)] = [form.len for form in reader.formats.values()]
    layouts = {
        n: _layout(path, reader, n)
        for n in reader.name_to_id
        if n in UNAVERAGED_MESSAGES | AVERAGED_MESSAGES.keys()
    }
    for name, layout in layouts.items():
        if layout.content.itemsize + HEAD_BYTES != lengths[layout.number]:
            raise LogError(f'{path}: the definition of {name} messages is damaged')
    found = stream_messages(
        path,
        lengths,
        {name: layout for name, layout in layouts.items() if name in UNAVERAGED_MESSAGES},
        {
            n: (layout, AVERAGED_MESSAGES[n])
            for n, layout in layouts.items()
            if n in AVERAGED_MESSAGES
        },
        most_rows,
    )
    notes = []
    if found.averaged > 1:
        notes.append(f'a long log: rows are means of {found.averaged} samples')
    tables = {name: _columns(rows, layouts[name]) for name, rows in found.messages.items()}
    return partial(_streamed_messages, path, tables | found.tables), found.lost, notes


def _streamed_messages(
    path: Path, tables: Mapping[str, dict[str, Any]], name: str, *needed: str
) -> dict[str, Any]:
    """Return the columns of the messages of a name, from tables that were read."""
    columns = tables.get(name, {})
    if not columns or not len(next(iter(columns.values()))):
        return {}
    check_columns(path, name, columns, (TIME_COLUMN, *needed))
    return columns


def _opened(path: Path, named: Path | None = None) -> Any:
    """Return pymavlink's reader, which indexes a file; errors name the log it is `named` for."""
    try:
        from pymavlink import DFReader
    except ImportError:
        raise LogError(
            f'{named or path}: reading this log needs pymavlink (pip install pymavlink)'
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
        raise LogError(f'{named or path}: damaged, cannot be read ({reason})') from None


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Drop what the parser, compiled code in part, says of damage: a line per byte."""
    sys.stderr.flush()
    kept, printed = os.dup(2), io.StringIO()
    try:
        with (
            Path(os.devnull).open('wb') as nothing,
            contextlib.redirect_stderr(printed),
            contextlib.redirect_stdout(printed),
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


def _layout(path: Path, reader: Any, name: str) -> MessageLayout:
    """Return how the messages of a name are laid out."""
    number = reader.name_to_id[name]
    form = reader.formats[number]
    items = _item_types(form.msg_struct)
    if len(items) != len(form.columns) or len(set(form.columns)) < len(form.columns):
        raise LogError(f'{path}: the definition of {name} messages is damaged')
    content = np.dtype(list(zip(form.columns, items, strict=True)))
    return MessageLayout(number, content, dict(zip(form.columns, form.msg_mults, strict=True)))


def _columns(rows: Any, layout: MessageLayout) -> dict[str, Any]:
    """Return the columns of messages, numbers in their units, texts as such."""
    columns = {}
    for column, factor in layout.factors.items():
        values = rows[column]
        if values.dtype.kind == 'S':
            columns[column] = [v.decode('ascii', 'replace') for v in values.tolist()]
        else:
            columns[column] = values if factor is None else values * factor
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


def _imus(path: Path, tables: Tables, parameters: Mapping[str, float]) -> list[LoggedImu]:
    found = dict(_instances(tables, 'IMU', *GYROSCOPE, *ACCELEROMETER))
    if not found:
        raise LogError(f'{path}: no IMU messages in it; {LOGGING_ADVICE}')
    fields = dict(_instances(tables, 'MAG', *MAGNETOMETER))
    boards = dict(_instances(tables, 'BARO'))
    turn = _board_rotation(path, parameters)
    imus = []
    for number, table in found.items():
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
                barometer_temperature=_channel(board, 'Temp'),
                pressure=_channel(board, 'Press'),
                hardware=_device_ids(parameters, number),
                notes=tuple(dict.fromkeys(notes)),
            )
        )
    return imus


def _instances(tables: Tables, name: str, *needed: str) -> list[tuple[int, dict[str, Any]]]:
    """Return the messages of each instance: by their field I, or by a number in their name."""
    table = tables(name, *needed)
    if INSTANCE_COLUMN in table:
        instance = np.asarray(table[INSTANCE_COLUMN])
        return [
            (k, {n: np.asarray(v)[instance == k] for n, v in table.items()})
            for k in np.unique(instance).tolist()
        ]
    others = ((k, tables(f'{name}{k + 1}', *needed)) for k in (1, 2))
    named = [(0, table), *others]
    return [(k, found) for k, found in named if found]


def _vector(table: Columns, names: Sequence[str]) -> FloatArray:
    return np.stack([np.asarray(table[name], float) for name in names], axis=1)


def _series(table: Columns, values: FloatArray) -> Series:
    return Series(np.asarray(table['TimeUS']).astype(np.int64) * 1000, values)


def _channel(table: Columns | None, name: str) -> Series | None:
    """Return one column of messages; None where there are none, or older ones without it."""
    if table is None or name not in table:
        return None
    return _series(table, np.asarray(table[name], float)[:, None])


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
    then = parameters.get(f'{sensor}_CALTEMP', REFERENCE_TEMPERATURE_C)
    total: FloatArray = np.zeros((len(temperature), 3))
    x, x0 = (
        np.clip(t, low, high) - REFERENCE_TEMPERATURE_C for t in (temperature, np.array([then]))
    )
    for k, axis in enumerate('XYZ'):
        for power in (1, 2, 3):
            factor = COEFFICIENT_SCALE * parameters.get(f'{prefix}_{kind}{power}_{axis}', 0.0)
            total[:, k] += factor * (x**power - x0**power)
    return total
