# SPDX-License-Identifier: Apache-2.0
"""A chamber's announcement of the run under way, JSON on chamber/run."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields, replace

from imu_recording.recording import RecordingError

RUN_TOPIC = 'chamber/run'


@dataclass(frozen=True)
class RunAnnouncement:
    """The run under way, or the one that is to come.

    A profile with several orientations is several runs.
    """

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
    """Topics the profile asks for; empty: all."""
    split: str = ''
    """When the profile begins a new file: 'phase', 'size' or 'none'; '' where it says nothing."""

    def text(self) -> str:
        """Return the announcement as the JSON that goes over chamber/run."""
        return json.dumps(asdict(self))


def parse_announcement(text: str) -> RunAnnouncement:
    """Return the announcement in a message; raise RecordingError where it is none.

    >>> parse_announcement(RunAnnouncement(run='x', runs=3, topics=('imu/*',)).text()).topics
    ('imu/*',)
    """
    try:
        content = json.loads(text)
        known = {item.name for item in fields(RunAnnouncement)}
        announcement = RunAnnouncement(
            **{key: value for key, value in content.items() if key in known}
        )
        return replace(
            announcement,
            runs=int(announcement.runs),
            topics=tuple(map(str, announcement.topics)),
        )
    except (ValueError, TypeError, AttributeError) as error:
        raise RecordingError(
            f'{RUN_TOPIC}: {text[:80]!r} is no announcement of a run ({error})'
        ) from error
