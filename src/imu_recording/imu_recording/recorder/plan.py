# SPDX-License-Identifier: Apache-2.0
"""Plan of a recording: the recorder's parameters combined with the run a chamber announces.

Each run of a profile with several orientations gets a bag of its own, named after the axis that
points up; nothing is recorded while the devices are turned.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from pathlib import Path

from imu_recording.recorder.run_announcement import RunAnnouncement
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


INTERNAL_TOPICS = ('/parameter_events', '/rosout')
"""Topics that are recorded only when named."""
MEGABYTE_BYTES = 1_000_000
SPLIT_PARAMETERS = {'phase': 'phase', 'size': '500 MB', 'none': 'none'}
"""When a file begins: a profile's word → the recorder's parameter `split`."""


@dataclass(frozen=True)
class RecordingPlan:
    """Folder, topics and files of the recording now."""

    folder: Path | None
    """None: nothing, until the next run begins."""
    topics: tuple[str, ...]
    at_phase: bool
    """Whether a file begins with each phase."""
    split_bytes: int
    metadata: Mapping[str, str]


def recording_plan(
    config: RecorderConfig, output: Path, announcement: RunAnnouncement
) -> RecordingPlan:
    """Return what to record during the run announced; parameters that are set come first.

    Name and orientation of one run of several always come from the announcement.
    """
    if announcement.runs > 1:
        config = replace(config, run=announcement.run, up_axis=announcement.up_axis)
    named = replace(
        config,
        run=config.run or announcement.run,
        up_axis=config.up_axis or announcement.up_axis,
        profile=config.profile or announcement.profile,
    )
    metadata = recording_metadata(output, named)
    if announcement.profile_sha256 and metadata.get('profile') == announcement.profile:
        metadata.setdefault('profile_sha256', announcement.profile_sha256)
    split = config.split or SPLIT_PARAMETERS.get(announcement.split, announcement.split) or 'phase'
    at_phase, size = parse_split(split)
    return RecordingPlan(
        folder=_folder(output, announcement),
        topics=tuple(config.topics) or announcement.topics,
        at_phase=at_phase,
        split_bytes=size,
        metadata=metadata,
    )


def further_output(output: Path) -> Path:
    """Return the next free name for the bag of another start of the profile.

    >>> further_output(Path('runs/today')).name, further_output(Path('runs/today_2')).name
    ('today_2', 'today_3')
    """
    stem, _, number = output.name.rpartition('_')
    if stem and number.isdecimal() and len(number) < 4:
        return output.with_name(f'{stem}_{int(number) + 1}')
    return output.with_name(f'{output.name}_2')


def _folder(output: Path, announcement: RunAnnouncement) -> Path | None:
    if announcement.runs <= 1:
        return output
    if not announcement.run:
        return None
    inside = output / announcement.run
    is_bag = any(output.glob(f'{output.name}_*.mcap'))
    return output.with_name(f'{output.name}_{announcement.run}') if is_bag else inside


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
            size = int(number) * MEGABYTE_BYTES
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
        return topic not in INTERNAL_TOPICS and '/_' not in topic
    return any(fnmatchcase(topic, p if p.startswith(('/', '*')) else f'/{p}') for p in patterns)


def missing_topics(patterns: Sequence[str], known: Collection[str]) -> list[str]:
    """Return the topics that are wanted by their whole name and not known.

    >>> missing_topics(['imu/mag', 'imu/magg', '/chamber/*'], ['/imu/mag'])
    ['/imu/magg']
    """
    named = [f'/{pattern.lstrip("/")}' for pattern in patterns if not set('*?[') & set(pattern)]
    return [topic for topic in named if topic not in known]


def output_folder(output: str, now: datetime | None = None) -> Path:
    """Return the bag's folder; '' is recordings/<UTC>."""
    if output:
        return Path(output)
    moment = now or datetime.now(UTC)
    return Path('recordings') / moment.strftime('%Y%m%dT%H%M%SZ')


def recording_metadata(folder: Path, config: RecorderConfig) -> dict[str, str]:
    """Return the bag's custom_data, with the profile's SHA-256 where its file is at hand.

    Where the profile is given by name, a profile.yaml in the folder is taken for its file.
    """
    if config.up_axis and config.up_axis not in UP_AXES:
        raise RecordingError(
            f'up_axis is {config.up_axis!r}, expected one of {", ".join(UP_AXES)}'
        )
    profile, file = config.profile, folder / 'profile.yaml'
    if profile.endswith(('.yaml', '.yml')):
        file = Path(profile)
        if not file.is_file():
            raise RecordingError(f'profile {profile}: no such file')
        profile = file.stem
    metadata = {
        'device': config.device,
        'run': config.run,
        'up_axis': config.up_axis,
        'profile': profile,
    }
    if file.is_file():
        metadata['profile_sha256'] = hashlib.sha256(file.read_bytes()).hexdigest()
    for entry in config.metadata:
        key, separator, value = entry.partition('=')
        if not separator or not key.strip():
            raise RecordingError(f'metadata {entry!r}, expected key=value')
        metadata[key.strip()] = value.strip()
    return {key: value for key, value in metadata.items() if value}
