# SPDX-License-Identifier: Apache-2.0
"""Without numba the same functions run, slower, and give the same numbers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from orientation_filters.filters import run_filter
from static_data import random_attitude, rest

CODE = """
import sys
sys.modules['numba'] = None
from imu_recording.jit import NUMBA
assert not NUMBA
import numpy as np
from orientation_filters.filters import run_filter
from static_data import random_attitude, rest
recording = rest(random_attitude(1), seed=1, seconds=3)
np.save(sys.argv[1], [
    run_filter(name, recording, preset=preset).orientation
    for name in ('complementary', 'ahrs') for preset in ('paper', 'robust')
])
"""


def test_plain_python_equals_compiled(tmp_path: Path) -> None:
    path = [str(Path(__file__).parent), *sys.path]
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(path)}
    target = tmp_path / 'plain.npy'
    subprocess.run([sys.executable, '-c', CODE, str(target)], check=True, env=environment)
    recording = rest(random_attitude(1), seed=1, seconds=3)
    compiled = [
        run_filter(name, recording, preset=preset).orientation
        for name in ('complementary', 'ahrs')
        for preset in ('paper', 'robust')
    ]
    np.testing.assert_allclose(np.load(target), compiled, rtol=0, atol=1e-12)
