# SPDX-License-Identifier: Apache-2.0
"""Message types: those of ROS 2 Jazzy, of installed packages, and those a bag defines itself."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

MESSAGE_TYPE = re.compile(r'([A-Za-z][A-Za-z0-9_]*)/msg/([A-Za-z][A-Za-z0-9_]*)')
MESSAGE_NAMES = {'double': 'float64', 'float': 'float32', 'boolean': 'bool', 'octet': 'byte'}
"""IDL type → its name in a .msg file."""


class DecodeError(ValueError):
    """Bytes that are no message of their type, or a definition that defines no type."""


@cache
def standard_types() -> Typestore:
    """Return the message types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def types_of(message_type: str, definition: str) -> Typestore:
    """Return the types to decode a topic by: the bag's own definition where it differs."""
    standard = standard_types()
    if not definition:
        return standard
    try:
        own = get_typestore(Stores.EMPTY)
        own.register(_parsed(message_type, definition))
        own.get_msgdef(message_type)
    except (TypesysError, LookupError, ValueError, AttributeError, TypeError) as error:
        kind = type(error).__name__
        raise DecodeError(f'definition of {message_type} is damaged ({kind})') from None
    if own.hash_rihs01(message_type) == standard.hash_rihs01(message_type):
        return standard
    return own


@cache
def definition_of(message_type: str) -> str:
    """Return the text of a type's definition, standard or installed; '' where it is neither."""
    types = _types_with(message_type)
    return str(types.generate_msgdef(message_type, ros_version=2)[0]) if types else ''


@cache
def hash_of(message_type: str) -> str:
    """Return the RIHS01 hash of a type, standard or installed; '' where it is neither."""
    types = _types_with(message_type)
    return str(types.hash_rihs01(message_type)) if types else ''


def _types_with(message_type: str) -> Typestore | None:
    types = standard_types()
    return types if message_type in types.fielddefs else installed_types(message_type)


def _parsed(message_type: str, definition: str) -> Any:
    separator = '=' * 80 + '\n'
    if not definition.startswith(f'{separator}IDL: '):
        return get_types_from_msg(definition, message_type)
    types: dict[str, Any] = {}
    for part in definition.split(separator)[1:]:
        types.update(get_types_from_idl(part.split('\n', 1)[1]))
    return types


@cache
def installed_types(message_type: str) -> Typestore | None:
    """Return a store with a type and its parts; None where one of them is not installed.

    Where a package brings no .msg file, the fields are those of its Python class: constants and
    default values are then missing.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    waiting, found = [message_type], set(store.fielddefs)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        text = message_text(name)
        if text is None:
            return None
        try:
            parsed: dict[str, Any] = dict(get_types_from_msg(text, name))
            store.register(parsed)
        except TypesysError:
            return None
        found.add(name)
        waiting += [part for _, fields in parsed.values() for part in _parts(fields)]
    return store


def message_text(message_type: str) -> str | None:
    """Return the text of the .msg file of a type, None where it is not installed.

    A name that is not spelt as a type, from a damaged or tampered bag, is not looked for.
    """
    spelt = MESSAGE_TYPE.fullmatch(message_type)
    if spelt is None:
        return None
    package, name = spelt.groups()
    for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep):
        file = Path(prefix) / 'share' / package / 'msg' / f'{name}.msg'
        if prefix and file.is_file():
            return file.read_text(encoding='utf-8')
    try:
        fields = getattr(import_module(f'{package}.msg'), name).get_fields_and_field_types()
    except (ImportError, AttributeError):
        return None
    return ''.join(f'{message_name(kind)} {field}\n' for field, kind in fields.items())


def message_name(kind: str) -> str:
    """Return how a .msg file writes the type of a field of a Python message class.

    >>> [message_name(k) for k in ('sequence<double>', 'sequence<my_msgs/Part, 3>', 'float[9]')]
    ['float64[]', 'my_msgs/Part[<=3]', 'float32[9]']
    >>> message_name('sequence<string<5>>')
    'string<=5[]'
    """
    if kind.startswith('sequence<'):
        of, _, bound = kind.removeprefix('sequence<').removesuffix('>').partition(', ')
        return f'{message_name(of)}[{f"<={bound}" if bound else ""}]'
    if kind.endswith(']'):
        of, _, count = kind.partition('[')
        return f'{message_name(of)}[{count}'
    if kind.startswith(('string<', 'wstring<')):
        return kind.replace('<', '<=').removesuffix('>')
    return MESSAGE_NAMES.get(kind, kind)


def _parts(fields: Any) -> Iterator[str]:
    """Yield the names of the message types among the fields, as rosbags describes them."""
    for _, (node, of) in fields:
        kind, name = of[0] if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (node, of)
        if kind == Nodetype.NAME:
            yield name
