# SPDX-License-Identifier: Apache-2.0
"""Which files a bag is made of, and what its metadata.yaml says."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from imu_recording.bags import sqlite
from imu_recording.bags.compression import ZSTD_MAGIC
from imu_recording.bags.mcap import writer as mcap
from imu_recording.bags.metadata import YAML_ERRORS
from imu_recording.deep_yaml import YAML_LOADER, refuse_deep_yaml
from imu_recording.recording import BagError

ROS1_MAGIC = b'#ROSBAG V2.0'
IMPORT_SUFFIXES = {'.csv', '.tsv', '.txt', '.ulg', '.bin', '.log'}
"""Suffixes of tables and of logs of autopilots."""
METADATA_FILE = 'metadata.yaml'
BAG_SUFFIXES = ('.mcap', '.db3', '.bag')
GLOB_SIGNS = frozenset('*?[')
"""Characters that make a pattern of a path."""
BAG_PATTERNS = 'metadata.yaml, *.mcap, *.db3, *.bag'


def yaml_content(text: str) -> Any:
    """Return what a YAML text holds; raise one of YAML_ERRORS where it holds nothing usable."""
    refuse_deep_yaml(text)
    return yaml.load(text, Loader=YAML_LOADER)  # noqa: S506 (safe, written in C)


@dataclass(frozen=True)
class BagFile:
    """One storage file."""

    path: Path
    storage: str
    """'mcap', 'sqlite3' or 'ros1'."""
    file_compressed: bool = False
    message_compressed: bool = False


@dataclass
class Bag:
    """A bag on disk: its files in order, its metadata, notes on what is missing or unreadable."""

    path: Path
    files: list[BagFile] = field(default_factory=list)
    custom: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def locate_bag(path: str | PathLike[str]) -> Bag:
    """Find a bag's files; raise BagError naming the path where there is none."""
    path = Path(path)
    if path.name == METADATA_FILE:
        path = path.parent
    if not path.exists():
        raise BagError(f'{path}: no such file or folder')
    bag = Bag(path)
    if path.is_dir():
        information = _metadata(path, bag)
        files = _files_of_folder(path, information, bag)
    else:
        beside = Bag(path)
        information = _metadata(path.parent, beside)
        listed = [Path(name).name for name in information.get('relative_file_paths') or []]
        information = information if path.name in listed else {}
        files = [path]
    bag.custom = {
        str(key): str(value) for key, value in (information.get('custom_data') or {}).items()
    }
    per_message = information.get('compression_mode') == 'message'
    for file in files:
        if not file.stat().st_size:
            bag.notes.append(f'{file.name} is empty')
            continue
        bag.files.append(_identified(file, per_message=per_message))
    if not bag.files:
        raise BagError(f'{path}: the bag is empty ({", ".join(f.name for f in files)}: 0 bytes)')
    return bag


def _metadata(folder: Path, bag: Bag) -> dict[str, Any]:
    """Return rosbag2_bagfile_information, or an empty dict with a note."""
    file = folder / METADATA_FILE
    if not file.is_file():
        bag.notes.append('metadata.yaml is missing: the recording was not closed')
        return {}
    try:
        text = file.read_text(encoding='utf-8', errors='replace')
        content = yaml_content(text)
        information = content['rosbag2_bagfile_information']
        return {
            'relative_file_paths': [str(p) for p in information.get('relative_file_paths') or []],
            'custom_data': dict(information.get('custom_data') or {}),
            'compression_mode': str(information.get('compression_mode') or '').lower(),
        }
    except YAML_ERRORS:
        bag.notes.append('metadata.yaml cannot be read: the files were scanned without it')
        return {}


def _files_of_folder(folder: Path, information: dict[str, Any], bag: Bag) -> list[Path]:
    present = sorted(
        (file for file in folder.iterdir() if file.is_file() and _is_storage(file)), key=_natural
    )
    named = [folder / Path(name).name for name in information.get('relative_file_paths') or []]
    missing = [file.name for file in named if not file.is_file()]
    if missing and present:
        bag.notes.append(f'{", ".join(missing)} named in metadata.yaml is missing')
    unlisted = [file for file in present if named and file not in named]
    if unlisted:
        names = ', '.join(file.name for file in unlisted)
        bag.notes.append(f'{names} is not in metadata.yaml: the recording was not closed')
    if missing and not present:
        raise BagError(f'{folder}: {missing[0]} named in metadata.yaml is missing')
    if not present:
        inner = sorted(sub.name for sub in folder.iterdir() if (sub / METADATA_FILE).is_file())
        if inner:
            raise BagError(f'{folder}: not a bag but a folder of bags; name one: {_few(inner)}')
        raise BagError(f'{folder}: no bag in this folder (looked for {BAG_PATTERNS})')
    return [file for file in named if file in present] + unlisted if named else present


def _is_storage(file: Path) -> bool:
    name = file.name.removesuffix('.zstd')
    return name.endswith(BAG_SUFFIXES)


def _natural(file: Path) -> list[tuple[int, str]]:
    return [(int(p), '') if p.isdecimal() else (0, p) for p in re.split(r'(\d+)', file.name)]


def _identified(file: Path, *, per_message: bool) -> BagFile:
    with file.open('rb') as stream:
        head = stream.read(16)
    if head.startswith(ZSTD_MAGIC):
        storage = 'sqlite3' if '.db3' in file.name else 'mcap'
        return BagFile(file, storage, file_compressed=True)
    for magic, storage in (
        (mcap.MAGIC, 'mcap'),
        (sqlite.MAGIC, 'sqlite3'),
        (ROS1_MAGIC, 'ros1'),
    ):
        if head.startswith(magic):
            return BagFile(file, storage, message_compressed=per_message and storage != 'ros1')
    way = '; `import` it first' if file.suffix.lower() in IMPORT_SUFFIXES else ''
    raise BagError(
        f'{file}: neither mcap nor sqlite3 nor a ROS 1 bag (its first bytes are wrong){way}'
    )


def _few(names: list[str]) -> str:
    return ', '.join(names[:8]) + (' …' if len(names) > 8 else '')
