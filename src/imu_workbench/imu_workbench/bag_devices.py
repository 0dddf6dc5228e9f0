# SPDX-License-Identifier: Apache-2.0
"""The recordings of a bag, one of each device in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from imu_recording.user_error import UserError

from imu_recording import ImuRecording


def read_devices(
    path: Path,
    namespace: str | None,
    remap: Mapping[str, str] | None,
    *,
    every_device: bool = False,
) -> Iterator[ImuRecording]:
    """Read one bag: the device in `namespace`, its only device, or every device in turn."""
    from imu_recording import bag_namespaces, read_bag

    chosen = namespace is not None or bool((remap or {}).get('imu/data_raw'))
    namespaces = [] if chosen else bag_namespaces(path)
    if len(namespaces) <= 1:
        return (read_bag(path, namespace=one, remap=remap) for one in (namespace,))
    if not every_device:
        names = ', '.join(namespaces)
        raise UserError(f'{path} holds several devices: {names}; choose one with --namespace')
    return (read_bag(path, namespace=one, remap=remap) for one in namespaces)
