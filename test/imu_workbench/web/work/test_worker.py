# SPDX-License-Identifier: Apache-2.0
"""The process that workers are forked from has all that their tasks need."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from imu_workbench.web.work import worker
from imu_workbench.web.work.jobs import PRELOADED_MODULE, TASK_SECONDS

BAG = Path(__file__).resolve().parents[4] / 'bags' / 'hidden_effect_x'
TASKS_AFTER_THE_IMPORT = """
import sys
from pathlib import Path
from imu_workbench.web.work.worker import preview, tasks

def loaded():
    return {name for name in sys.modules if name.split('.')[0] in PACKAGES}

def hear(text, share=0.0):
    pass

PACKAGES = ('imu_recording', 'imu_workbench', 'thermal_comp', 'numba', 'numpy', 'scipy')
bag, folder = map(Path, sys.argv[1:])
before = loaded()
bags = tasks.read_task(hear, bag, folder / 'stored', {})
tasks.prepare_task(hear, bags, folder / 'prepared.runs')
opened = tasks.version_task(hear, folder / 'prepared.runs', None, 'line per axis', [])
model = opened.version.model_text
preview.preview_task(
    hear, folder / 'prepared.runs', model, 'thermal_lag', 'accelerometer', None, []
)
print(sorted(loaded() - before))
"""


def test_every_task_stands_in_a_module_that_is_imported_beforehand() -> None:
    assert worker.__name__ == PRELOADED_MODULE
    modules = [getattr(worker, name) for name in worker.__all__]
    ready = {name for module in modules for name in vars(module) if name.endswith('_task')}
    assert set(TASK_SECONDS) <= ready


def test_no_task_imports_what_the_process_did_not_have(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-c', TASKS_AFTER_THE_IMPORT, str(BAG), str(tmp_path)],
        capture_output=True, text=True, check=True, timeout=120,
    )  # fmt: skip
    assert done.stdout.strip() == '[]'
