# SPDX-License-Identifier: Apache-2.0
"""Message types: those of ROS 2 Jazzy, and those a bag defines otherwise."""

from __future__ import annotations

from functools import cache
from typing import Any

from rosbags.typesys import (
    Stores,
    TypesysError,
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
)
from rosbags.typesys.store import Typestore

from imu_recording.bags.decoding.installed_types import installed_types


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
