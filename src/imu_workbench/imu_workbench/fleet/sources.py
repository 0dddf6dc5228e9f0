# SPDX-License-Identifier: Apache-2.0
"""Which devices paths, globs, list files and URLs hold; nothing of a bag is read but its name.

A device is the bags in one folder that name the same device in their metadata. Its lot and type
come from parts of the path written `lot=A` and `type=LSM9DS1`, or from a list file.
"""

from __future__ import annotations

import csv
import hashlib
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Any

import yaml
from imu_recording.bags.files import METADATA, SUFFIXES
from imu_recording.user_error import UserError

GLOB_SIGNS = frozenset('*?[')
LIST_SUFFIXES = ('.txt', '.csv')
NO_LOT, NO_TYPE = 'none', 'none'
"""Lot and type of a device that has none."""
CHANGES_WITH_CONTENT = ('size', 'mtime', 'LastModified', 'ETag', 'etag', 'md5Hash')
"""What file systems tell of a file that another content changes."""
CUSTOM_DATA = re.compile(r'^  custom_data:\n((?:    .*\n)+)', re.MULTILINE)
LIST_COLUMNS = ('source', 'lot', 'type')


@dataclass(frozen=True)
class DeviceSource:
    """The bags of one device, and what tells that they are the same as last time."""

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


@dataclass(frozen=True)
class _Bag:
    url: str
    folder: str
    """What holds the bag: its device's folder."""
    files: tuple[str, ...]
    """Name and state of each file."""
    device: str = ''


def find_devices(sources: Sequence[str]) -> list[DeviceSource]:
    """Return the devices the sources hold, in order of their names.

    A source is a bag, a folder with bags at any depth, a glob, a URL that fsspec knows of any of
    these, or a list file: `.txt` with a source a line, `.csv` with the columns source, lot, type.
    Raises UserError where one holds nothing.
    """
    found: dict[str, DeviceSource] = {}
    for text in sources:
        for device in _devices_of(text):
            found.setdefault(device.key, device)
    return sorted(found.values(), key=lambda device: (device.lot, device.device, device.key))


def _devices_of(text: str) -> Iterator[DeviceSource]:
    if text.endswith(LIST_SUFFIXES) and not GLOB_SIGNS & set(text):
        for row in _listed(text):
            for device in _devices_of(row['source']):
                lot, kind = row.get('lot') or device.lot, row.get('type') or device.type
                yield replace(device, lot=lot, type=kind)
        return
    bags = list(_bags(text))
    if not bags:
        raise UserError(f'{text}: no bag here, nor in a folder below')
    groups: dict[tuple[str, str], list[_Bag]] = defaultdict(list)
    for bag in bags:
        groups[bag.folder, bag.device].append(bag)
    for (folder, name), own in groups.items():
        own.sort(key=lambda bag: bag.url)
        digest = hashlib.sha256('\n'.join(line for bag in own for line in bag.files).encode())
        yield DeviceSource(
            key=f'{folder}#{name}',
            device=name,
            lot=_part('lot', folder) or NO_LOT,
            type=_part('type', folder) or NO_TYPE,
            bags=tuple(bag.url for bag in own),
            fingerprint=digest.hexdigest(),
        )


def _part(name: str, path: str) -> str:
    """Return the value of a part of a path.

    >>> _part('lot', '/data/lot=A/A00001')
    'A'
    """
    return next((p[len(name) + 1 :] for p in path.split('/') if p.startswith(f'{name}=')), '')


def _listed(path: str) -> list[dict[str, str]]:
    import fsspec

    with fsspec.open(path, 'rt', encoding='utf-8') as stream:
        lines = [line for line in stream.read().splitlines() if line.strip()]
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


def _bags(text: str) -> Iterator[_Bag]:
    """Yield the bags below a path, glob or URL, with the device each names."""
    from fsspec.core import url_to_fs

    try:
        files, root = url_to_fs(text)
    except (ValueError, ImportError) as error:
        raise UserError(f'{text}: {error}') from None
    paths = files.glob(root) if GLOB_SIGNS & set(root) else [root]
    listed: dict[str, Mapping[str, Any]] = {}
    single = set()
    for path in paths:
        if files.isdir(path):
            listed |= files.find(path, detail=True)
        elif files.exists(path):
            listed[path] = files.info(path)
            single.add(path)
    stored: dict[str, list[str]] = defaultdict(list)
    for path in listed:
        if path.removesuffix('.zstd').endswith(SUFFIXES):
            stored[path if path in single else path.rpartition('/')[0]].append(path)
    names = _device_names(
        files, [f'{b}/{METADATA}' for b in stored if f'{b}/{METADATA}' in listed]
    )
    for bag, parts in stored.items():
        yield _Bag(
            url=files.unstrip_protocol(bag).removeprefix('file://'),
            folder=files.unstrip_protocol(str(PurePosixPath(bag).parent)).removeprefix('file://'),
            files=tuple(_state(path, listed[path]) for path in sorted(parts)),
            device=names.get(bag, ''),
        )


def _state(path: str, info: Mapping[str, Any]) -> str:
    return f'{path} ' + ' '.join(str(info[key]) for key in CHANGES_WITH_CONTENT if key in info)


def _device_names(files: Any, metadata: Iterable[str]) -> dict[str, str]:
    """Return the device each bag's metadata names, by bag."""
    paths = list(metadata)
    texts = files.cat(paths, on_error='omit') if paths else {}
    if isinstance(texts, bytes):
        texts = {paths[0]: texts}
    names = {}
    for path, text in texts.items():
        block = CUSTOM_DATA.search(text.decode('utf-8', 'replace'))
        if block:
            try:
                custom = yaml.safe_load(block[1])
            except yaml.YAMLError:
                continue
            names[path.removesuffix(f'/{METADATA}')] = str(custom.get('device') or '')
    return names
