# SPDX-License-Identifier: Apache-2.0
"""A case: a device's recordings, what was found, every version of its model, in a folder on disk.

The folder holds `case.yaml`, the model file of each version in `versions/`, and in `found/` what a
diagnosis said of it. Every change is on disk before it is shown: files are written beside their
place and moved there, the model before `case.yaml` names it. Versions are a tree; none is deleted.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import yaml
from imu_recording.user_error import UserError, fault_in_yaml

SCHEMA = 1
FOUND_SCHEMA = 2
"""Schema of the files in `found/`; a diagnosis in an earlier one is made anew."""
CASE_FILE = 'case.yaml'
LOCK_FILE = '.lock'


class CaseError(UserError):
    """A case folder that cannot be used; the message says what is wrong with it."""


@dataclass(frozen=True)
class CaseRecording:
    """One recording of the device."""

    source: str
    """Path of its bag."""
    run: str
    sha256: str = ''
    """Of its columns; '' until they were prepared."""
    samples: int = 0
    open: bool = True
    """Whether the page shows it and fits use it."""
    modified: int = 0
    """Newest modification of its files [ns since 1970] when it was read."""
    size: int = 0
    """Their size [bytes] then."""


@dataclass(frozen=True)
class CaseVersion:
    """One version of the model."""

    name: str
    """v1, v2 …"""
    parent: str | None
    label: str
    """What was done to get here."""
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Per sensor: measured, error (held out) and floor, rms over the axes [SI unit]."""
    recordings: tuple[str, ...] = ()
    """Runs it was fitted to."""


@dataclass(frozen=True)
class RequestedFit:
    """A fit that was asked for and is not done yet."""

    base: str
    """The version it starts from."""
    effect: str
    sensors: tuple[str, ...] = ()
    added: bool = True
    tab: str = ''
    """The browser tab that asked for it: it shows the version that is made."""


@dataclass(frozen=True)
class Case:
    """What `case.yaml` holds."""

    folder: Path
    device: str
    recordings: tuple[CaseRecording, ...] = ()
    versions: tuple[CaseVersion, ...] = ()
    current: str = ''
    """The version that was shown last."""
    requested: tuple[RequestedFit, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Effect files, names of topics."""
    notes: str = ''

    def version(self, name: str) -> CaseVersion | None:
        """Return a version by its name."""
        return next((v for v in self.versions if v.name == name), None)

    def path_to(self, name: str) -> list[CaseVersion]:
        """Return the versions from the first to this one."""
        path: list[CaseVersion] = []
        step = self.version(name)
        while step is not None:
            path.append(step)
            step = self.version(step.parent) if step.parent else None
        return path[::-1]

    def tree(self) -> list[tuple[CaseVersion, int]]:
        """Return every version after its parent, with its depth: 0 up to the first branching."""
        return list(self._below(None, 0))

    def _below(self, parent: str | None, depth: int) -> Iterator[tuple[CaseVersion, int]]:
        children = [v for v in self.versions if v.parent == parent]
        for child in children:
            yield child, depth
            branches = depth > 0 or len(self.children(child.name)) > 1
            yield from self._below(child.name, depth + branches)

    def children(self, name: str) -> list[CaseVersion]:
        """Return the versions made from one."""
        return [v for v in self.versions if v.parent == name]

    def model_file(self, name: str) -> Path:
        """Return where the model of a version stands."""
        return self.folder / 'versions' / f'{name}.yaml'

    def model_text(self, name: str) -> str:
        """Return the model file of a version; CaseError where it is gone."""
        try:
            return self.model_file(name).read_text('utf-8')
        except OSError as error:
            raise CaseError(
                f'{self.model_file(name)}: {error.strerror}; put it back, or work on another '
                'version of the case'
            ) from None

    @property
    def sources(self) -> tuple[str, ...]:
        """Paths of the bags that are open, each once."""
        return tuple(dict.fromkeys(r.source for r in self.recordings if r.open))


def with_version(
    case: Case,
    parent: str | None,
    label: str,
    model_text: str,
    errors: Mapping[str, Mapping[str, float]],
    recordings: Sequence[str] = (),
) -> Case:
    """Return the case with one more version, which is the current one then; both are on disk."""
    name = f'v{1 + max((int(v.name[1:]) for v in case.versions), default=0)}'
    write_atomically(case.model_file(name), model_text)
    version = CaseVersion(
        name=name, parent=parent, label=label, errors=errors, recordings=tuple(recordings)
    )
    return saved(replace(case, versions=(*case.versions, version), current=name))


def with_found(case: Case, version: str, found: Mapping[str, Any]) -> Case:
    """Keep the diagnosis of a version over the open recordings."""
    content = {
        'schema': FOUND_SCHEMA,
        'recordings': known_recordings(case),
        'found': found,
    }
    text = json.dumps(content, ensure_ascii=False, indent=1)
    write_atomically(case.folder / 'found' / f'{version}.json', text)
    return case


def found_in(case: Case, version: str) -> dict[str, Any] | None:
    """Return the diagnosis of a version over the open recordings; None where there is none yet."""
    try:
        content = json.loads((case.folder / 'found' / f'{version}.json').read_text('utf-8'))
    except (OSError, json.JSONDecodeError):
        return None  # it is only kept to save the work of finding it again
    if not isinstance(content, dict) or content.get('schema') != FOUND_SCHEMA:
        return None
    return content.get('found') if content.get('recordings') == known_recordings(case) else None


def known_recordings(case: Case) -> list[str]:
    """Return the hashes of the open recordings, in order."""
    return sorted(r.sha256 for r in case.recordings if r.open)


def is_unchanged(recording: CaseRecording) -> bool:
    """Tell whether the files of a recording are those that were read."""
    path = Path(recording.source)
    return path.exists() and file_state(path) == (recording.modified, recording.size)


def file_state(bag: Path) -> tuple[int, int]:
    """Return newest modification [ns since 1970] and total size [bytes] of a bag's files."""
    files = [bag] if bag.is_file() else [p for p in bag.iterdir() if p.is_file()]
    stats = [file.stat() for file in files]
    return max((s.st_mtime_ns for s in stats), default=0), sum(s.st_size for s in stats)


def saved(case: Case) -> Case:
    """Write `case.yaml`; return the case."""
    content: dict[str, Any] = {
        'schema': SCHEMA,
        'device': case.device,
        'recordings': [asdict(recording) for recording in case.recordings],
        'versions': [
            asdict(v) | {'recordings': list(v.recordings), 'model': f'versions/{v.name}.yaml'}
            for v in case.versions
        ],
        'current': case.current,
        'requested': [asdict(r) | {'sensors': list(r.sensors)} for r in case.requested],
        'settings': dict(case.settings),
        'notes': case.notes,
    }
    text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=99)
    write_atomically(case.folder / CASE_FILE, text)
    return case


def write_atomically(path: Path, text: str) -> None:
    """Write a file so that every reader, after a crash too, finds the old or the new one whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f'.{path.name}.partial')
    with partial.open('w', encoding='utf-8') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(path)


def is_case(folder: Path) -> bool:
    """Tell whether a folder is a case."""
    return (folder / CASE_FILE).is_file()


def cases_in(folder: Path) -> list[Path]:
    """Return the cases in a folder: itself, or those right below."""
    if is_case(folder):
        return [folder]
    below = sorted(folder.iterdir()) if folder.is_dir() else []
    return [path for path in below if is_case(path)]


def load_case(folder: Path) -> Case:
    """Return the case in a folder; CaseError names what cannot be read."""
    path = folder / CASE_FILE
    try:
        content = path.read_bytes()
    except OSError as error:
        raise CaseError(f'{path}: {error.strerror}; name a folder with a {CASE_FILE}') from None
    return parse_case(folder, content, str(path))


def parse_case(folder: Path, text: bytes, place: str) -> Case:
    """Return the case that a `case.yaml` holds; CaseError names `place` and what is wrong."""
    try:
        content = yaml.safe_load(text.decode('utf-8'))
    except (yaml.YAMLError, ValueError) as error:  # no UTF-8, or a date that is none
        raise CaseError(f'{place}: not a YAML file: {fault_in_yaml(error)}') from None
    if not isinstance(content, dict) or content.get('schema') != SCHEMA:
        schema = content.get('schema') if isinstance(content, dict) else None
        raise CaseError(
            f'{place}: schema is {schema!r}, expected {SCHEMA}: not a case of this kind'
        )
    try:
        case = _case_of(folder, content)
    except (KeyError, TypeError, ValueError) as error:
        raise CaseError(
            f'{place}: {type(error).__name__} {error}: restore the file, or begin a new case with '
            '--case DIR'
        ) from None
    names = [v.name for v in case.versions]
    for version in case.versions:
        if version.parent is not None and version.parent not in names:
            raise CaseError(
                f'{place}: version {version.name} follows {version.parent}, which is not there'
            )
    return case


def _case_of(folder: Path, content: Mapping[str, Any]) -> Case:
    versions = []
    for item in content['versions']:
        row = {key: value for key, value in item.items() if key != 'model'}
        int(str(row['name']).removeprefix('v'))
        versions.append(CaseVersion(**row | {'recordings': tuple(row['recordings'])}))
    requested = [
        RequestedFit(**row | {'sensors': tuple(row['sensors'])}) for row in content['requested']
    ]
    return Case(
        folder=folder,
        device=str(content['device']),
        recordings=tuple(_recording_of(row) for row in content['recordings']),
        versions=tuple(versions),
        current=str(content['current']),
        requested=tuple(requested),
        settings=dict(content['settings']),
        notes=str(content['notes']),
    )


def _recording_of(row: Mapping[str, Any]) -> CaseRecording:
    recording = CaseRecording(**row)
    if not isinstance(recording.source, str):
        raise TypeError(f'source {recording.source!r} is no path')
    return recording


def case_of_device(folder: Path, device: str) -> Case:
    """Return the case of a device in a folder of cases; a new one where there is none."""
    known = [case for path in cases_in(folder) if (case := load_case(path)).device == device]
    if known:
        return known[0]
    place = folder / (''.join(c if c.isalnum() or c in '-_.' else '_' for c in device) or 'device')
    if is_case(place):  # of another device whose name makes the same folder
        place = place.with_name(f'{place.name}_{len(cases_in(folder))}')
    return saved(Case(place, device))


def lock_cases(folder: Path) -> TextIOWrapper:
    """Take a folder of cases for this process; the lock ends with the process.

    The file has to be kept open as long as the lock is wanted.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = (folder / LOCK_FILE).open('a', encoding='utf-8')
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            raise
        raise CaseError(
            f'{folder}: another server has these cases open; use its page, or keep other cases '
            'with --case DIR'
        ) from None
    return file
