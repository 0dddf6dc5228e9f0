# SPDX-License-Identifier: Apache-2.0
"""Parameters of the recorder node and what they mean: topics, splitting, folder, metadata."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Protocol

from imu_recording.recording import UP_AXES, RecordingError
from imu_recording.ros.parameter import NodeConfig, parameter


@dataclass(frozen=True)
class RecorderConfig(NodeConfig):
    """Parameters of the recorder."""

    output: str = parameter('', 'Folder of the bag; empty: recordings/<UTC>')
    topics: list[str] = parameter(  # noqa: RUF009
        [], 'Topics to record, * and ? allowed; empty: those of the profile, or all'
    )
    split: str = parameter(
        '', "When to begin a file: 'phase', 'none', '500 MB', both; empty: as the profile says"
    )
    device: str = parameter('', 'Serial number or name of the device, for the metadata')
    run: str = parameter('', 'Name of the run, for the metadata; empty: as chamber/run says')
    up_axis: str = parameter('', 'Sensor axis that points up, +x … -z; empty: as chamber/run says')
    profile: str = parameter('', 'Name or file of the thermal profile, for the metadata')
    metadata: list[str] = parameter([], "Further metadata, 'key=value'")  # noqa: RUF009


INTERNAL = ('/parameter_events', '/rosout')
"""Topics that are recorded only when named."""
MEGABYTE = 1_000_000
LOW_DISK = 1 << 30
"""Less free space is worth a warning [bytes]."""


def parse_split(text: str) -> tuple[bool, int]:
    """Return whether files split at phases, and the size at which they do [bytes, 0 never].

    >>> parse_split('phase'), parse_split('none'), parse_split('phase, 500 MB')
    ((True, 0), (False, 0), (True, 500000000))
    """
    at_phase, size = False, 0
    for part in text.split(','):
        word = part.strip().lower()
        number = word.removesuffix('mb').strip()
        if word == 'phase':
            at_phase = True
        elif word.endswith('mb') and number.isdecimal() and int(number):
            size = int(number) * MEGABYTE
        elif word != 'none':
            raise RecordingError(
                f"split is {text!r}, expected 'phase', 'none', a size such as '500 MB', "
                "or 'phase, 500 MB'"
            )
    return at_phase, size


def is_wanted(topic: str, patterns: Sequence[str]) -> bool:
    """Tell whether a topic is to be recorded; no patterns: every topic but ROS's own.

    >>> is_wanted('/dut1/imu/mag', ['*/imu/*']), is_wanted('/rosout', [])
    (True, False)
    >>> is_wanted('/imu/mag', ['imu/mag'])
    True
    """
    if not patterns:
        return topic not in INTERNAL and '/_' not in topic
    return any(fnmatchcase(topic, p if p.startswith(('/', '*')) else f'/{p}') for p in patterns)


def output_folder(output: str, now: datetime | None = None) -> Path:
    """Return the bag's folder; '' is recordings/<UTC>."""
    if output:
        return Path(output)
    moment = now or datetime.now(UTC)
    return Path('recordings') / moment.strftime('%Y%m%dT%H%M%SZ')


def recorder_health(
    failure: str, unknown: Collection[str], free: int, waiting: str = ''
) -> tuple[int, str]:
    """Return the level (0 ok, 1 warn, 2 error) and line for /diagnostics."""
    if failure:
        return 2, f'recording stopped: {failure}'
    if unknown:
        return 1, f'types not installed: {", ".join(sorted(unknown))}'
    if free < LOW_DISK:
        return 1, f'{free / MEGABYTE:.0f} MB left on the disk'
    return 0, waiting or 'recording'


class Named(Protocol):
    """What names a recording."""

    @property
    def device(self) -> str:
        """Serial number or name of the device."""

    @property
    def run(self) -> str:
        """Name of the run."""

    @property
    def up_axis(self) -> str:
        """Sensor axis that points up."""

    @property
    def profile(self) -> str:
        """Name of the thermal profile, or its file."""

    @property
    def metadata(self) -> list[str]:
        """Further entries 'key=value'."""


def recording_metadata(folder: Path, named: Named) -> dict[str, str]:
    """Return the bag's custom_data, with the profile's SHA-256 where its file is at hand.

    Where the profile is given by name, a profile.yaml in the folder is taken for its file.
    """
    if named.up_axis and named.up_axis not in UP_AXES:
        raise RecordingError(f'up_axis is {named.up_axis!r}, expected one of {", ".join(UP_AXES)}')
    profile, file = named.profile, folder / 'profile.yaml'
    if profile.endswith(('.yaml', '.yml')):
        file = Path(profile)
        if not file.is_file():
            raise RecordingError(f'profile {profile}: no such file')
        profile = file.stem
    metadata = {
        'device': named.device,
        'run': named.run,
        'up_axis': named.up_axis,
        'profile': profile,
    }
    if file.is_file():
        metadata['profile_sha256'] = hashlib.sha256(file.read_bytes()).hexdigest()
    for entry in named.metadata:
        key, separator, value = entry.partition('=')
        if not separator or not key.strip():
            raise RecordingError(f'metadata {entry!r}, expected key=value')
        metadata[key.strip()] = value.strip()
    return {key: value for key, value in metadata.items() if value}
