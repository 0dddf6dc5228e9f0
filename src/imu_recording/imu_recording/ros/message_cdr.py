# SPDX-License-Identifier: Apache-2.0
"""Message objects as CDR bytes whose padding is zero, and as flat columns of numbers.

The middleware leaves padding uninitialised: only bytes written here are equal for equal messages.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from imu_recording.bags.decoding.cdr import ENCAPSULATION

_FORMATS = {
    'boolean': 'B',
    'octet': 'B',
    'byte': 'B',
    'char': 'B',
    'float': 'f',
    'double': 'd',
    **{f'int{bits}': c for bits, c in ((8, 'b'), (16, 'h'), (32, 'i'), (64, 'q'))},
    **{f'uint{bits}': c for bits, c in ((8, 'B'), (16, 'H'), (32, 'I'), (64, 'Q'))},
}
_FIELDS_OF_TYPE: dict[Any, list[tuple[str, str, str, bool]]] = {}
_ARRAY = re.compile(r'^(?P<of>[\w/]+)\[(?P<count>\d+)\]$')
_SEQUENCE = re.compile(r'^sequence<(?P<of>[\w/]+)(?:, \d+)?>$')


def message_class(message_type: str) -> Any:
    """Return the class of e.g. 'sensor_msgs/msg/Imu'."""
    package, _, name = message_type.split('/')
    return getattr(import_module(f'{package}.msg'), name)


def type_of(message: Any) -> str:
    """Return the message's type, e.g. 'sensor_msgs/msg/Imu'."""
    return f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'


def serialise(message: Any) -> bytes:
    """Return the message as little-endian CDR, padding zero."""
    out = bytearray()
    _write(out, message)
    return ENCAPSULATION + bytes(out)


def _write(out: bytearray, message: Any) -> None:
    for name, kind, of, _ in _fields(type(message)):
        value = getattr(message, name)
        if kind == 'single':
            _write_one(out, of, value)
            continue
        if kind == 'sequence':
            _write_number(out, 'I', len(value))
        letter = _FORMATS.get(of)
        if letter is None:
            for item in value:
                _write_one(out, of, item)
        elif len(value):
            numbers = [item[0] if isinstance(item, bytes) else item for item in value]
            out += bytes(-len(out) % struct.calcsize(letter))
            out += struct.pack(f'<{len(numbers)}{letter}', *numbers)


def _write_one(out: bytearray, of: str, value: Any) -> None:
    if of in _FORMATS:
        _write_number(out, _FORMATS[of], value[0] if isinstance(value, bytes) else value)
    elif of.startswith('string'):
        text = value.encode() + b'\x00'
        _write_number(out, 'I', len(text))
        out += text
    else:
        _write(out, value)


def _write_number(out: bytearray, letter: str, value: Any) -> None:
    out += bytes(-len(out) % struct.calcsize(letter))
    out += struct.pack(f'<{letter}', value)


def numbers_of(message: Any, prefix: str = '') -> Iterator[tuple[str, float]]:
    """Give name and value of every floating-point field, depth first; headers are left out."""
    for name, kind, of, is_message in _fields(type(message)):
        value = getattr(message, name)
        if of == 'std_msgs/Header' or kind == 'sequence':
            continue
        if is_message and kind == 'single':
            yield from numbers_of(value, f'{prefix}{name}.')
        elif of in ('double', 'float'):
            items = enumerate(value) if kind == 'array' else ((None, value),)
            for place, item in items:
                yield f'{prefix}{name}' + ('' if place is None else f'[{place}]'), float(item)


def _fields(message_type: Any) -> list[tuple[str, str, str, bool]]:
    """Return (field, 'single' | 'array' | 'sequence', element type, whether that is a message)."""
    if message_type in _FIELDS_OF_TYPE:
        return _FIELDS_OF_TYPE[message_type]
    found = []
    declared: dict[str, str] = message_type.get_fields_and_field_types()
    for name, text in declared.items():
        array, sequence = _ARRAY.match(text), _SEQUENCE.match(text)
        match = array or sequence
        of = match['of'] if match else text
        kind = 'array' if array else 'sequence' if sequence else 'single'
        found.append((name, kind, of, '/' in of))
    _FIELDS_OF_TYPE[message_type] = found
    return found
