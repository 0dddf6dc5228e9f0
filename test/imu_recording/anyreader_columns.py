# SPDX-License-Identifier: Apache-2.0
"""The slow, independent way to columns: rosbags AnyReader, message by message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore


def columns(path: Path, topic: str, *fields: str) -> dict[str, Any]:
    """Stamp (header's, else receipt), receipt and the named fields of one topic."""
    found: dict[str, list[Any]] = {'stamp': [], 'received': [], **{name: [] for name in fields}}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = [c for c in reader.connections if c.topic == topic]
        assert wanted, f'{topic} is not in {path}'
        for connection, received, raw in reader.messages(wanted):
            message: Any = reader.deserialize(raw, connection.msgtype)
            header = getattr(message, 'header', None)
            stamp = header.stamp.sec * 10**9 + header.stamp.nanosec if header else received
            found['stamp'].append(stamp)
            found['received'].append(received)
            for name in fields:
                value = getattr(message, name)
                if hasattr(value, 'w'):
                    value = (value.x, value.y, value.z, value.w)
                elif hasattr(value, 'x'):
                    value = (value.x, value.y, value.z)
                found[name].append(value)
    return {name: np.array(values) for name, values in found.items()}
