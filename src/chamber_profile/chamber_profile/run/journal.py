# SPDX-License-Identifier: Apache-2.0
"""The journal of a run: one JSON object per line, on the disk before what it says happens."""

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
FORMAT = 1


class JournalError(UserError):
    """A run directory that cannot be used; the message names it and a way out."""


@dataclass(frozen=True)
class InterruptedRun:
    """What a run directory says about a run that did not end."""

    profile: Profile
    progress: Progress
    """Where it was, in IDLE: nothing moves before a start."""


class Journal:
    """Appends notes to the journal of a run directory; each is synced before `write` returns."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        directory.mkdir(parents=True, exist_ok=True)
        path = directory / JOURNAL_FILE
        _cut_torn_line(path)
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        _sync_directory(directory)

    def begin(self, profile: Profile, stamp: int, **facts: Any) -> None:
        """Write what is run, and a copy of the profile beside the journal."""
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
                'format': FORMAT,
                'profile': profile.name,
                'sha256': profile.sha256,
                'orientations': list(profile.orientations),
                **facts,
            }
        )

    def write(self, note: Note, stamp: int, **facts: Any) -> None:
        """Write a note with the ROS time [ns] it was taken at."""
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
            with contextlib.suppress(OSError):  # the next entry must not be glued to half a line
                os.ftruncate(self._descriptor, whole)
            raise


def read_journal(directory: Path) -> list[dict[str, Any]]:
    """Return the journal's entries; a last line torn by a power cut is left out."""
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
    """Return whether the directory holds the journal of a run already."""
    return (directory / JOURNAL_FILE).is_file() and (directory / PROFILE_FILE).is_file()


def load_run(directory: Path) -> InterruptedRun:
    """Return the run of a directory where it was interrupted; refuse one that is finished."""
    entries = read_journal(directory)
    path = directory / PROFILE_FILE
    try:
        profile = parse_profile(path.read_text(encoding='utf-8'), str(path))
    except (OSError, ProfileError) as error:
        raise JournalError(f'{directory}: the run has no usable profile: {error}') from error
    opened = [entry for entry in entries if entry['event'] == 'open']
    if not opened:
        raise JournalError(f'{directory}: the journal does not say what was run')
    if opened[0]['sha256'] != profile.sha256:
        raise JournalError(f'{path} was changed since the run began; put the original back')
    turned = opened[0].get('orientations', profile.orientations)
    profile = replace(profile, orientations=tuple(turned))
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


def _cut_torn_line(path: Path) -> None:
    """A line that a power cut tore is no entry; the next one must not be glued to it."""
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
