# SPDX-License-Identifier: Apache-2.0
"""After the precompile step nothing that a user runs compiles."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

LATER = """
import gc, json, sys
from imu_recording import read_bag
from numba.core.dispatcher import Dispatcher
from thermal_comp.comparison.compare import compare
from thermal_comp.compensation.recording import compensate
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.precompile import precompile

def compiled():
    found = [d for d in gc.get_objects() if isinstance(d, Dispatcher)]
    return {f'{d.__module__}.{d.__name__} {s}' for d in found for s in d.signatures
            if d.__module__.startswith(('thermal_comp', 'imu_recording'))}

precompile()
before = compiled()
recording = read_bag(sys.argv[1]).rows(slice(0, None, 8))
effects = [EFFECTS['bias_temperature'](), EFFECTS['thermal_lag'](), EFFECTS['icing']()]
model = fit(effects, [recording])
compare(model, [recording])
compensate(recording, model)
diagnose([recording])
print(json.dumps({'kernels': sorted(before), 'later': sorted(compiled() - before)}))
"""


@pytest.mark.long
def test_nothing_is_compiled_after_the_precompile_step(bags: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-c', LATER, str(bags / 'hidden_effect_z')],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, 'OMP_NUM_THREADS': '1'},
    )
    answer = json.loads(done.stdout)
    names = {kernel.split(' ')[0].rpartition('.')[2] for kernel in answer['kernels']}
    assert {'_innovate', '_fill_gains', '_follow', '_play', '_grow_and_melt', 'far_rows'} <= names
    assert {'find_messages', 'decode_messages', 'read_leaves'} <= names
    assert answer['later'] == []
