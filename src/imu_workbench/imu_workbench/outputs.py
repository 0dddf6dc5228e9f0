# SPDX-License-Identifier: Apache-2.0
"""What verbs may write over: nothing that is read, whatever is forced; else only by force."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from imu_recording.user_error import UserError

OUTPUT_OPTIONS = {
    'output': '-o',
    'json': '--json',
    'plot': '--plot',
    'html': '--html',
    'csv': '--csv',
    'write_golden': '--write-golden',
}
"""Options that name what a verb writes, as they are given."""
REPLACEABLE_INPUTS = {'model'}
"""Inputs that a user may replace: a model by the next one."""
RECORDING_SUFFIXES = {'.mcap', '.db3', '.bag', '.ulg', '.bin', '.bbl'}
"""Suffixes of files that hold measurements."""


def refuse_to_destroy(options: Namespace) -> None:
    """Refuse to write over what is read, over a recording, or JSON over a file of another kind.

    Raises UserError naming the option and the path.
    """
    read = set(_inputs(options))
    for name, given in OUTPUT_OPTIONS.items():
        path = getattr(options, name, None)
        if not isinstance(path, Path) or not path.exists():
            continue
        if path.resolve() in read:
            raise UserError(f'{given} {path} is what is read: choose another name')
        if path.is_file() and _is_recording(path):
            raise UserError(f'{given} {path} belongs to a recording: choose another name')
        if name == 'json' and path.is_file() and path.suffix.lower() != '.json':
            raise UserError(f'--json {path} exists and is no .json file: choose another name')


def _inputs(options: Namespace) -> Iterator[Path]:
    """Return the resolved paths of what is read."""
    for name, value in vars(options).items():
        given = value if isinstance(value, list) else [value]
        if name not in OUTPUT_OPTIONS and name not in REPLACEABLE_INPUTS:
            yield from (path.resolve() for path in given if isinstance(path, Path))


def _is_recording(path: Path) -> bool:
    if path.name == 'metadata.yaml':
        return 'rosbag2' in path.read_text('utf-8', 'replace')
    return path.suffix.lower() in RECORDING_SUFFIXES


def claim_output(target: Path, *, force: bool, folder: bool = False) -> None:
    """Refuse an output that exists, unless `force`; a file's folder has to exist.

    With `force` a bag replaces a bag (`folder`); no other folder is ever replaced.
    """
    if not folder and not target.parent.is_dir():
        raise UserError(f'{target}: there is no folder {target.parent}')
    if not target.exists():
        return
    if not force:
        raise UserError(f'{target} exists already: choose another -o, or replace it with --force')
    if target.is_dir() != folder or (folder and not (target / 'metadata.yaml').is_file()):
        kind = 'a bag' if folder else 'a file'
        raise UserError(f'{target} is not {kind}: --force does not replace it; choose another -o')


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Give a path for a bag that takes the target's place once it is written, and not before."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=f'.{target.name}.', dir=target.parent) as folder:
        fresh = Path(folder) / target.name  # files of a bag are named after their folder
        yield fresh
        if target.exists():
            target.rename(Path(folder) / 'replaced')
        fresh.rename(target)
