# SPDX-License-Identifier: Apache-2.0
"""The journal of a run: one JSON object per line, on disk before the action it announces."""

from __future__ import annotations

import contextlib
import json
import os
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError

from chamber_profile.profile.check import ProfileError
from chamber_profile.profile.file import parse_profile
from chamber_profile.profile.values import Profile
from chamber_profile.run.values import FINISHED, IDLE, Note, Progress

JOURNAL_FILE = 'journal.jsonl'
PROFILE_FILE = 'profile.yaml'
FORMAT_VERSION = 1


class JournalError(UserError):
    """A run directory that cannot be used; the message names it and what to do."""


@dataclass(frozen=True)
class InterruptedRun:
    """A run that has not ended, from its directory."""

    profile: Profile
    progress: Progress
    """Progress of the run, in IDLE: only a start continues it."""


class Journal:
    """Appends notes to the journal of a run directory; each is synced before `write` returns."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        directory.mkdir(parents=True, exist_ok=True)
        path = directory / JOURNAL_FILE
        _cut_incomplete_line(path)
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        _sync_directory(directory)

    def begin(self, profile: Profile, stamp: int, **facts: Any) -> None:
        """Write the entry that identifies the run, and a copy of its profile."""
        path = self.directory / PROFILE_FILE
        if not path.exists():
            part = path.with_suffix('.part')
            with part.open('w', encoding='utf-8') as stream:
                stream.write(profile.text)
                stream.flush()
                os.fsync(stream.fileno())
            part.replace(path)
            _sync_directory(self.directory)
        self._append(
            {
                'stamp': stamp,
                'event': 'open',
                'format': FORMAT_VERSION,
                'profile': profile.name,
                'sha256': profile.sha256,
                'orientations': list(profile.orientations),
                **facts,
            }
        )

    def write(self, note: Note, stamp: int, **facts: Any) -> None:
        """Write a note with its ROS time [ns]."""
        self._append(
            {
                'stamp': stamp,
                'event': note.event,
                **asdict(note.progress),
                **facts,
                **note.details,
            }
        )

    def close(self) -> None:
        """Release the file."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _append(self, entry: dict[str, Any]) -> None:
        line = json.dumps(entry, ensure_ascii=False, allow_nan=False) + '\n'
        data = line.encode()
        whole = os.fstat(self._descriptor).st_size
        try:
            while data:
                data = data[os.write(self._descriptor, data) :]
            os.fsync(self._descriptor)
        except OSError:
            with contextlib.suppress(OSError):  # the next entry needs a line of its own
                os.ftruncate(self._descriptor, whole)
            raise


def read_journal(directory: Path) -> list[dict[str, Any]]:
    """Return the journal's entries without an incomplete last line (power cut)."""
    path = directory / JOURNAL_FILE
    try:
        lines = path.read_bytes().split(b'\n')
    except OSError as error:
        raise JournalError(f'{directory}: no journal of a run: {error.strerror}') from error
    entries = []
    for number, line in enumerate(lines[:-1], 1):
        try:
            entry = json.loads(line)
        except ValueError as error:
            raise JournalError(f'{path}: line {number} is damaged: {error}') from error
        if not isinstance(entry, dict) or 'event' not in entry:
            raise JournalError(f'{path}: line {number} is no journal entry')
        entries.append(entry)
    return entries


def holds_run(directory: Path) -> bool:
    """Return whether the directory holds the journal of a run."""
    return (directory / JOURNAL_FILE).is_file() and (directory / PROFILE_FILE).is_file()


def load_run(directory: Path) -> InterruptedRun:
    """Return the interrupted run of a directory; raise JournalError where it is finished."""
    entries = read_journal(directory)
    path = directory / PROFILE_FILE
    try:
        profile = parse_profile(path.read_text(encoding='utf-8'), str(path))
    except (OSError, ProfileError) as error:
        raise JournalError(f'{directory}: the run has no usable profile: {error}') from error
    opened = [entry for entry in entries if entry['event'] == 'open']
    if not opened:
        raise JournalError(f'{directory}: the journal has no entry that identifies the run')
    if opened[0]['sha256'] != profile.sha256:
        raise JournalError(f'{path} was changed since the run began; put the original back')
    orientations = opened[0].get('orientations', profile.orientations)
    profile = replace(profile, orientations=tuple(orientations))
    progress = _last_progress(entries)
    if progress.mode in FINISHED:
        raise JournalError(
            f'{directory}: the run is finished ({progress.mode}); '
            f'leave run_directory empty to begin a new one'
        )
    return InterruptedRun(profile, replace(progress, mode=IDLE))


def _last_progress(entries: list[dict[str, Any]]) -> Progress:
    names = {item.name for item in fields(Progress)}
    for entry in reversed(entries):
        if names <= set(entry):
            return Progress(**{name: entry[name] for name in names})
    return Progress()


def _cut_incomplete_line(path: Path) -> None:
    """Remove an incomplete last line (power cut), which the next entry would continue."""
    if not path.exists():
        return
    data = path.read_bytes()
    whole = data.rfind(b'\n') + 1
    if whole < len(data):
        with path.open('r+b') as stream:
            stream.truncate(whole)
            os.fsync(stream.fileno())


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
