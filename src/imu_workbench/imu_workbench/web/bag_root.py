# SPDX-License-Identifier: Apache-2.0
"""The folder a server opens bags from, and nothing above it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imu_recording.bags.files import BAG_SUFFIXES
from imu_recording.user_error import UserError

MAX_SEARCH_DEPTH = 4
"""Folders below the root that are searched."""


class RootError(UserError):
    """A path the server does not open; the message says what it would open."""


@dataclass(frozen=True)
class BagRoot:
    """A resolved folder."""

    folder: Path

    @classmethod
    def of(cls, bags: Sequence[Path], folder: Path | None = None) -> BagRoot:
        """Return the given root, else the nearest folder above all bags, else the current one."""
        if folder is not None:
            if not folder.is_dir():
                raise RootError(f'--root {folder}: no such folder')
            return cls(folder.resolve())
        parents = [str(bag.resolve().parent) for bag in bags]
        return cls(Path(os.path.commonpath(parents)) if parents else Path.cwd().resolve())

    def locate(self, text: str | Path) -> Path:
        """Return a path below the root, links resolved; relative ones start at the root."""
        try:
            path = (self.folder / Path(text).expanduser()).resolve()
            outside = not path.is_relative_to(self.folder)
            missing = not outside and not path.exists()
            files = list(path.iterdir()) if not outside and path.is_dir() else []
            outside |= not all(file.resolve().is_relative_to(self.folder) for file in files)
        except (OSError, ValueError, RuntimeError) as error:
            raise RootError(f'{str(text)[:80]!r} cannot be opened: {error}') from None
        if outside:
            raise RootError(
                f'{text}: outside {self.folder}; copy it there, or start the server with a --root '
                'that holds it'
            )
        if missing:
            raise RootError(f'{text}: no such file or folder below {self.folder}')
        return path

    def name_of(self, path: Path) -> str:
        """Return a path as shown: relative to the root."""
        return str(path.relative_to(self.folder)) if path != self.folder else path.name

    def bags(self) -> list[Path]:
        """Return the bags below the root: folders with metadata.yaml, and storage files."""
        found: list[Path] = []
        self._search(self.folder, MAX_SEARCH_DEPTH, found)
        return sorted(found)

    def _search(self, folder: Path, depth: int, found: list[Path]) -> None:
        try:
            entries = sorted(folder.iterdir())
        except OSError:
            return
        if any(entry.name == 'metadata.yaml' for entry in entries):
            found.append(folder)
            return
        for entry in entries:
            if entry.name.startswith('.') or entry.is_symlink():
                continue
            if entry.is_dir() and depth:
                self._search(entry, depth - 1, found)
            elif entry.suffix in BAG_SUFFIXES:
                found.append(entry)
