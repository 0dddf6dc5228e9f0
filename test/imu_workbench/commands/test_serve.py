# SPDX-License-Identifier: Apache-2.0
"""serve: a path that is not there is refused; being ended, it waits for no work."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from imu_recording.user_error import UserError
from imu_workbench.commands.serve import sort_paths

OWN_EFFECT = """
from dataclasses import dataclass

from thermal_comp.effects import Effect


@dataclass(frozen=True)
class Kink(Effect):
    name = 'kink'
    equation = 'error = a · max(0, T − 10 °C)'
    coefficient_units = ('{unit}/K',)

    def columns(self, conditions, state=None):
        return (conditions.temperature - 10.0).clip(0.0)[:, None], None
"""


WAITING = """
import multiprocessing
from pathlib import Path

if multiprocessing.parent_process():
    Path({held_by!r}).read_bytes()
"""


def test_being_ended_it_waits_for_no_work_under_way(tmp_path: Path, bags: Path) -> None:
    held_by, effect = tmp_path / 'held_by', tmp_path / 'my_effect.py'
    os.mkfifo(held_by)
    effect.write_text(WAITING.format(held_by=str(held_by)) + OWN_EFFECT, 'utf-8')
    command = [sys.executable, '-m', 'imu_workbench', 'serve', '--port', '0']
    paths = [str(bags / 'dut1_x'), '--effects', str(effect), '--case', str(tmp_path / 'cases')]
    server = subprocess.Popen([*command, *paths], stdout=subprocess.PIPE)
    try:
        with held_by.open('w'):  # opened as soon as a worker reads from it, which goes on waiting
            server.terminate()
            assert server.wait(timeout=120.0) == 0
    finally:
        server.kill()
        server.communicate()


def test_a_path_that_does_not_exist_is_refused_with_the_way_out(tmp_path):
    absent = tmp_path / 'absent'
    with pytest.raises(
        UserError, match='absent: no such file or folder; name a bag or the folder'
    ):
        sort_paths([absent])
