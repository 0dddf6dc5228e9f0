# SPDX-License-Identifier: Apache-2.0
"""Kernels kept on disk are used again while what went into them is as it was, and only then."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CONSTANT = 'OFFSET = {offset}\n'
PART = """
from imu_recording.jit import inline

@inline()
def part(x):
    return {factor} * x
"""
WHOLE = """
from imu_recording.jit import compiled_here, njit
from constant import OFFSET
from part import part

@njit
def whole(x):
    return part(x) + OFFSET

print(whole(2.0), len(compiled_here()))
"""

SAVED_WHILE_HELD = """
import fcntl
from pathlib import Path
cache = whole._cache._cache_file
index = cache._load_index

def looked_up():
    for path in Path(__file__).parent.rglob('saving.lock'):
        with path.open('a') as other:
            try:
                fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                print('held')
    return index()

cache._load_index = looked_up
whole(2)
"""


def write(folder: Path, *, factor: float = 3.0, offset: float = 1.0) -> None:
    (folder / 'constant.py').write_text(CONSTANT.format(offset=offset))
    (folder / 'part.py').write_text(PART.format(factor=factor))
    (folder / 'whole.py').write_text(WHOLE)


def run(folder: Path, **environment: str) -> str:
    path = os.pathsep.join([str(folder), *sys.path])
    variables = {**os.environ, 'PYTHONPATH': path, **environment}
    command = [sys.executable, '-B', str(folder / 'whole.py')]
    return subprocess.run(
        command, check=True, env=variables, capture_output=True, text=True
    ).stdout.strip()


@pytest.mark.long
def test_a_change_anywhere_in_what_was_compiled_in_is_seen(tmp_path: Path) -> None:
    write(tmp_path)
    assert run(tmp_path) == '7.0 1'
    assert run(tmp_path) == '7.0 0'
    write(tmp_path, factor=4.0)
    assert run(tmp_path) == '9.0 1'
    write(tmp_path, factor=4.0, offset=2.0)
    assert run(tmp_path) == '10.0 1'


def test_no_two_processes_save_a_kernel_at_once(tmp_path: Path) -> None:
    """Each would give its code the next free name in the index, and run that of the other."""
    write(tmp_path)
    (tmp_path / 'whole.py').write_text(WHOLE + SAVED_WHILE_HELD)
    assert run(tmp_path, NUMBA_CACHE_DIR=str(tmp_path)).endswith('held')


def test_kernels_run_where_nothing_can_be_written(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / '__pycache__').write_text('a file, so no folder can be made here')
    home = tmp_path / 'home'
    assert run(tmp_path, XDG_CACHE_HOME=str(home)) == '7.0 1'
    assert any(home.rglob('whole.whole-*.nbc'))
    assert run(tmp_path, XDG_CACHE_HOME=str(tmp_path / 'constant.py')) == '7.0 1'


@pytest.mark.long
def test_who_has_to_wait_for_compilation_is_told_once(tmp_path: Path) -> None:
    write(tmp_path)
    # asked for before numba is there, as nodes do
    told = 'from imu_recording.compilation import COMPILATION_LISTENERS as listeners\n'
    told += "listeners.append(lambda: print('compiling'))\n" + WHOLE
    (tmp_path / 'whole.py').write_text(f'{told}print(whole(2))\n')
    assert run(tmp_path).split() == ['compiling', '7.0', '1', '7.0']
    assert run(tmp_path).split() == ['7.0', '0', '7.0']
