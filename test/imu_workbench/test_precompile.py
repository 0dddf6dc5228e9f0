# SPDX-License-Identifier: Apache-2.0
"""The set-up's compilation: garbage is collected again after it, and every module is imported."""

from __future__ import annotations

import gc
import subprocess
import sys

import pytest
from imu_workbench.precompile import Compilation

MODULES = """
import sys
from imu_workbench.precompile import import_modules
import_modules()
print(*sys.modules)
"""


def test_garbage_is_left_alone_while_a_part_compiles_and_collected_after_it() -> None:
    seen = []
    Compilation('part', 1.0, lambda: seen.append(gc.isenabled())).run()
    assert seen == [False]
    assert gc.isenabled()


@pytest.mark.long
def test_modules_of_every_package_are_imported_but_no_main() -> None:
    done = subprocess.run([sys.executable, '-c', MODULES], capture_output=True, check=True)
    modules = set(done.stdout.decode().split())
    assert {
        'imu_workbench.report.certificate.content',
        'thermal_comp.diagnosis.diagnose',
        'orientation_filters.ahrs.filter',
        'chamber_profile.node',
        'imu_driver.node',
        'imu_recording.logs',
    } <= modules
    assert 'imu_recording.__main__' not in modules
