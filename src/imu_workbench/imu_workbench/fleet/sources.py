# SPDX-License-Identifier: Apache-2.0
"""Which devices paths, globs, list files and URLs hold; nothing of a bag is read but its name.

A device is a case (`case.yaml`: its open recordings), or the bags in one folder that name the same
device in their metadata; a bag that a case names belongs to the case. Lot and type come from parts
of the path written `lot=A` and `type=LSM9DS1`, or from a list file.
"""

from __future__ import annotations

import csv
import hashlib
import os
import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import yaml
from imu_recording.bags.files import BAG_SUFFIXES, GLOB_SIGNS, METADATA_FILE
from imu_recording.user_error import UserError

from imu_workbench.case import CASE_FILE, Case, CaseError, parse_case

LIST_SUFFIXES = ('.txt', '.csv')
NO_LOT, NO_TYPE = 'none', 'none'
"""Lot and type of a device that has none."""
CHANGES_WITH_CONTENT = ('size', 'mtime', 'LastModified', 'ETag', 'etag', 'md5Hash')
"""Properties of a file, as file systems report them, that change with its content."""
CUSTOM_DATA = re.compile(r'^  custom_data:\n((?:    .*\n)+)', re.MULTILINE)
LIST_COLUMNS = ('source', 'lot', 'type')


@dataclass(frozen=True)
class DeviceSource:
    """The bags of one device, and a fingerprint that shows whether they have changed."""

    key: str
    """Folder and name of the device: its identity from run to run."""
    device: str
    """Name in the bags' metadata; '' where they have none."""
    lot: str
    type: str
    bags: tuple[str, ...]
    """Paths or URLs of bags."""
    fingerprint: str
    """SHA-256 of name, size and time of change of every file."""
    case: str = ''
    """Folder or URL of the case it comes from."""
    problem: str = ''
    """Why it cannot be estimated, where that shows before a bag is read."""


@dataclass(frozen=True)
class _Bag:
    url: str
    folder: str
    """What holds the bag: its device's folder."""
    files: tuple[str, ...]
    """Name and state of each file."""
    device: str = ''


@dataclass(frozen=True)
class _SearchResult:
    """What a path, glob or URL holds."""

    bags: tuple[_Bag, ...]
    cases: Mapping[str, bytes | Exception]
    """Folder or URL of a case → text of its `case.yaml`, or why it cannot be read."""
    closed: tuple[str, ...]
    """Folders that may not be read."""


def find_devices(sources: Sequence[str]) -> list[DeviceSource]:
    """Return the devices the sources hold, in order of their names.

    A source is a bag, a case, a folder with bags or cases at any depth, a glob, a URL that fsspec
    knows of any of these, or a list file: `.txt` with a source a line, `.csv` with the columns
    source, lot, type. Raises UserError where one holds nothing.
    """
    found: dict[str, DeviceSource] = {}
    for text in sources:
        for device in _devices_of(text):
            found.setdefault(device.key, device)
    in_cases = {bag for device in found.values() if device.case for bag in device.bags}
    own = [
        one
        for one in found.values()
        if one.case or one.problem or not in_cases.issuperset(one.bags)
    ]
    return sorted(own, key=lambda device: (device.lot, device.device, device.key))


def reason(error: Exception) -> str:
    """Return what went wrong in one line."""
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, OSError) and error.filename:
        return f'{error.filename}: {error.strerror}'
    return f'{type(error).__name__}: {error}'


def _devices_of(text: str, lists: tuple[str, ...] = ()) -> Iterator[DeviceSource]:
    """Yield the devices of a source; `lists` are the list files that led to it."""
    if text in lists:
        raise UserError(f'{text}: a list that leads to itself: {" → ".join((*lists, text))}')
    if text.endswith(LIST_SUFFIXES) and not GLOB_SIGNS & set(text):
        for row in _listed(text):
            for device in _listed_devices(row['source'], (*lists, text)):
                lot, kind = row.get('lot') or device.lot, row.get('type') or device.type
                yield replace(device, lot=lot, type=kind)
        return
    found = _search(text)
    if not (found.bags or found.cases or found.closed):
        raise UserError(f'{text}: no bag here and no case, nor in a folder below')
    for folder, content in found.cases.items():
        yield _device_of_case(folder, content)
    yield from _devices_of_folders(found)


def _devices_of_folders(found: _SearchResult) -> Iterator[DeviceSource]:
    """Yield the devices whose bags stand in one folder; one that misses a part has a problem."""
    folders: dict[str, dict[str, list[_Bag]]] = defaultdict(lambda: defaultdict(list))
    for bag in found.bags:
        folders[bag.folder][bag.device].append(bag)
    problems = {path: f'{path}: no permission to read it' for path in found.closed}
    for folder, devices in folders.items():
        if len(devices) == 2 and '' in devices:  # the nameless bag is of the only device
            (name,) = (name for name in devices if name)
            devices[name] += devices.pop('')
        inside = [path for path in problems if path.rpartition('/')[0] == folder]
        problem = problems[inside[0]] if inside else ''
        for name, own in devices.items():
            yield replace(_device_of_bags(folder, name, own), problem=problem)
    for path, problem in problems.items():
        if path.rpartition('/')[0] not in folders:
            yield replace(_device_of_bags(path, '', []), problem=problem)


def _listed_devices(source: str, lists: tuple[str, ...]) -> Iterator[DeviceSource]:
    """Yield the devices of one line of a list; a line that holds nothing is one with a problem."""
    try:
        yield from _devices_of(source, lists)
    except UserError as error:
        empty = _device_of_bags(source.rstrip('/'), '', [])
        yield replace(empty, problem=f'{error} (in {lists[-1]})')


def _device_of_bags(folder: str, name: str, bags: Sequence[_Bag]) -> DeviceSource:
    own = sorted(bags, key=lambda bag: bag.url)
    digest = hashlib.sha256('\n'.join(line for bag in own for line in bag.files).encode())
    return DeviceSource(
        key=f'{folder}#{name}',
        device=name,
        lot=_part('lot', folder) or NO_LOT,
        type=_part('type', folder) or NO_TYPE,
        bags=tuple(bag.url for bag in own),
        fingerprint=digest.hexdigest(),
    )


def _device_of_case(folder: str, content: bytes | Exception) -> DeviceSource:
    """Return the device of a case and its open recordings; what is wrong stands in `problem`."""
    place = f'{folder}/{CASE_FILE}'
    try:
        if isinstance(content, Exception):
            raise CaseError(f'{place}: {reason(content)}; make it readable')
        case = parse_case(Path(folder), content, place)
        bags = {source: _search(_recording_path(folder, source)).bags for source in case.sources}
    except UserError as error:
        empty = _device_of_bags(folder, '', [])
        return replace(empty, case=folder, problem=str(error))
    problem = _missing(case, bags)
    device = _device_of_bags(folder, case.device, [bag for own in bags.values() for bag in own])
    lots = [_part('lot', bag) for bag in device.bags]
    types = [_part('type', bag) for bag in device.bags]
    return replace(
        device,
        lot=_part('lot', folder) or next(filter(None, lots), NO_LOT),
        type=_part('type', folder) or next(filter(None, types), NO_TYPE),
        case=folder,
        problem=problem,
    )


def _recording_path(folder: str, source: str) -> str:
    """Return where the recording of a case is: a relative path starts here, or in the case."""
    if '://' in source or Path(source).exists():
        return source
    return f'{folder}/{source}' if not Path(source).is_absolute() else source


def _missing(case: Case, bags: Mapping[str, Sequence[_Bag]]) -> str:
    """Return what is wrong with the recordings of a case; '' where nothing is."""
    if not bags:
        return f'{case.folder}: no recording of the case is open; open one with `serve`'
    gone = [source for source, own in bags.items() if not own]
    if gone:
        return (
            f'{case.folder}: its recording {gone[0]} is not there; put it back, or close it '
            'in the case'
        )
    return ''


def _part(name: str, path: str) -> str:
    """Return the value of a part of a path.

    >>> _part('lot', '/data/lot=A/A00001')
    'A'
    """
    return next((p[len(name) + 1 :] for p in path.split('/') if p.startswith(f'{name}=')), '')


def _listed(path: str) -> list[dict[str, str]]:
    import fsspec

    try:
        with fsspec.open(path, 'rt', encoding='utf-8') as stream:
            lines = [line for line in stream.read().splitlines() if line.strip()]
    except (ValueError, ImportError) as error:
        raise UserError(f'{path}: {error}') from None
    if path.endswith('.txt'):
        return [{'source': line.strip()} for line in lines if not line.startswith('#')]
    reader = csv.DictReader(lines)
    columns = reader.fieldnames or []
    if 'source' not in columns or set(columns) - set(LIST_COLUMNS):
        raise UserError(
            f'{path}: its columns are {", ".join(columns) or "none"}; '
            'a list has source and, where known, lot and type'
        )
    return [{key: (value or '').strip() for key, value in row.items()} for row in reader]


def _search(text: str) -> _SearchResult:
    """Return the bags below a path, glob or URL, with the device each names, and the cases."""
    from fsspec.core import url_to_fs

    try:
        return _search_in(*url_to_fs(text))
    except (ValueError, ImportError, OSError) as error:
        raise UserError(f'{text}: {reason(error)}') from None


def _search_in(files: Any, root: str) -> _SearchResult:
    is_glob = GLOB_SIGNS & set(root) and not files.exists(root)
    paths = files.glob(root) if is_glob else [root]
    listed: dict[str, Mapping[str, Any]] = {}
    single = set()
    for path in paths:
        if files.isdir(path):
            listed |= files.find(path, detail=True, withdirs=True)
        elif files.exists(path):
            listed[path] = files.info(path)
            single.add(path)
    folders = [path for path, info in listed.items() if info['type'] == 'directory']
    listed = {path: info for path, info in listed.items() if info['type'] != 'directory'}
    stored: dict[str, list[str]] = defaultdict(list)
    for path in listed:
        if path.removesuffix('.zstd').endswith(BAG_SUFFIXES):
            stored[path if path in single else path.rpartition('/')[0]].append(path)
    names = _device_names(
        files, [f'{b}/{METADATA_FILE}' for b in stored if f'{b}/{METADATA_FILE}' in listed]
    )
    url = partial(_url_of, files)
    bags = tuple(
        _Bag(
            url=url(bag),
            folder=url(str(PurePosixPath(bag).parent)),
            files=tuple(_state(path, listed[path]) for path in sorted(parts)),
            device=names.get(bag, ''),
        )
        for bag, parts in stored.items()
    )
    texts = _contents(files, [p for p in sorted(listed) if p.rpartition('/')[2] == CASE_FILE])
    cases = {url(path.rpartition('/')[0]): text for path, text in texts.items()}
    closed = [p for p in (*paths, *folders) if 'file' in files.protocol and not _readable(p)]
    return _SearchResult(bags, cases, tuple(dict.fromkeys(closed)))


def _url_of(files: Any, path: str) -> str:
    """Return the URL of a path in a file system; of this machine's, the path alone."""
    return str(files.unstrip_protocol(path)).removeprefix('file://')


def _readable(path: str) -> bool:
    return not os.path.isdir(path) or os.access(path, os.R_OK | os.X_OK)  # noqa: PTH112 (a URL's)


def _state(path: str, info: Mapping[str, Any]) -> str:
    return f'{path} ' + ' '.join(str(info[key]) for key in CHANGES_WITH_CONTENT if key in info)


def _contents(files: Any, paths: Sequence[str]) -> dict[str, bytes | Exception]:
    """Return the bytes of files, many at a time where the file system can, or why not."""
    found: dict[str, bytes | Exception] = {}
    if 'file' not in files.protocol:
        return dict(files.cat(list(paths), on_error='return')) if paths else {}
    for path in paths:
        try:
            found[path] = files.cat_file(path)
        except OSError as error:
            found[path] = error
    return found


def _device_names(files: Any, metadata: Sequence[str]) -> dict[str, str]:
    """Return the device each bag's metadata names, by bag; those that name none are left out."""
    names = {}
    for path, text in _contents(files, metadata).items():
        block = None if isinstance(text, Exception) else CUSTOM_DATA.search(_text(text))
        try:
            custom = yaml.safe_load(block[1]) if block else None
        except (yaml.YAMLError, ValueError):  # a date that is none is a ValueError
            continue
        if isinstance(custom, dict):
            names[path.removesuffix(f'/{METADATA_FILE}')] = str(custom.get('device') or '')
    return names


def _text(content: bytes) -> str:
    return content.decode('utf-8', 'replace').replace('\r\n', '\n')
