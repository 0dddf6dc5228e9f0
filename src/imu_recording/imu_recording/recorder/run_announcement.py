# SPDX-License-Identifier: Apache-2.0
"""What a chamber says on chamber/run about the run under way, and what a recording makes of it.

A profile with several orientations is several runs: each gets a bag of its own, named after the
axis that points up; nothing is recorded while the devices are turned.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from imu_recording.recorder.settings import RecorderConfig, parse_split, recording_metadata
from imu_recording.recording import RecordingError

RUN_TOPIC = 'chamber/run'
SPLITS = {'phase': 'phase', 'size': '500 MB', 'none': 'none'}
"""A profile's word for when a file begins → a recorder's."""


@dataclass(frozen=True)
class RunNotice:
    """The run under way, or the one that is to come."""

    directory: str = ''
    """Name of the run directory: the same after a restart, another for another start."""
    run: str = ''
    """'x' … '-z'; '' between two runs or where the profile states no orientation."""
    runs: int = 1
    """How many runs the profile has, one for each orientation."""
    up_axis: str = ''
    profile: str = ''
    profile_sha256: str = ''
    topics: tuple[str, ...] = ()
    """What the profile wants recorded; empty: everything."""
    split: str = ''
    """Its word for when a file begins: a key of SPLITS."""

    def text(self) -> str:
        """Return the notice as the JSON that goes over chamber/run."""
        return json.dumps(asdict(self))


@dataclass(frozen=True)
class RecordingPlan:
    """Where and what to record now."""

    folder: Path | None
    """None: nothing, until the next run begins."""
    topics: tuple[str, ...]
    at_phase: bool
    """Whether a file begins with each phase."""
    split_bytes: int
    metadata: Mapping[str, str]


def parse_notice(text: str) -> RunNotice:
    """Return the notice of a message; raise RecordingError where it is none.

    >>> parse_notice(RunNotice(run='x', runs=3, topics=('imu/*',)).text()).topics
    ('imu/*',)
    """
    try:
        content = json.loads(text)
        known = {item.name for item in fields(RunNotice)}
        notice = RunNotice(**{key: value for key, value in content.items() if key in known})
        return replace(notice, runs=int(notice.runs), topics=tuple(map(str, notice.topics)))
    except (ValueError, TypeError, AttributeError) as error:
        raise RecordingError(f'{RUN_TOPIC}: {text[:80]!r} is no run: {error}') from error


def recording_plan(config: RecorderConfig, output: Path, notice: RunNotice) -> RecordingPlan:
    """Return what to record under a notice. What `config` says itself counts more.

    Only the name and the orientation of one run of several are the chamber's to say.
    """
    named = config
    if notice.runs > 1:
        named = replace(config, run=notice.run, up_axis=notice.up_axis)
    named = replace(
        named,
        run=named.run or notice.run,
        up_axis=named.up_axis or notice.up_axis,
        profile=config.profile or notice.profile,
    )
    metadata = recording_metadata(output, named)
    if notice.profile_sha256 and metadata.get('profile') == notice.profile:
        metadata.setdefault('profile_sha256', notice.profile_sha256)
    split = config.split or SPLITS.get(notice.split, notice.split) or 'phase'
    at_phase, size = parse_split(split)
    return RecordingPlan(
        folder=_folder(output, notice),
        topics=tuple(config.topics) or notice.topics,
        at_phase=at_phase,
        split_bytes=size,
        metadata=metadata,
    )


def further_output(output: Path) -> Path:
    """Return the folder of a recorder that has recorded another run of the profile there.

    >>> further_output(Path('runs/today')).name, further_output(Path('runs/today_2')).name
    ('today_2', 'today_3')
    """
    stem, _, number = output.name.rpartition('_')
    if stem and number.isdecimal() and len(number) < 4:
        return output.with_name(f'{stem}_{int(number) + 1}')
    return output.with_name(f'{output.name}_2')


def _folder(output: Path, notice: RunNotice) -> Path | None:
    if notice.runs <= 1:
        return output
    if not notice.run:
        return None
    inside = output / notice.run
    is_bag = any(output.glob(f'{output.name}_*.mcap'))
    return output.with_name(f'{output.name}_{notice.run}') if is_bag else inside
