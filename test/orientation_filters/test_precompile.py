# SPDX-License-Identifier: Apache-2.0
"""After `precompile` no filter waits for a kernel, over a recording or live."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PROGRAM = """
from imu_recording import jit
from orientation_filters.filters import FILTERS, filter_parameters, run_filter
from orientation_filters.live.filter import live_state
from orientation_filters.parameters import PRESET_NAMES
from orientation_filters.precompile import precompile
from orientation_filters.smoothing import run_smoother
from orientation_filters.upsampling import upsample
from recordings import moving, samples_of


def compiled() -> dict[str, int]:
    names = [f'{kernel.py_func.__module__}.{kernel.py_func.__name__}' for kernel in jit._KERNELS]
    counts = [len(kernel.signatures) for kernel in jit._KERNELS]
    return {n: c for n, c in zip(names, counts) if n.startswith('orientation_filters.')}


precompile()
before = compiled()
print('left out:', [name for name in before if not before[name] and name[-7:] != '.update'])
recording = upsample(moving(1, seconds=1.0), 200.0)
for name in FILTERS:
    run_smoother(name, recording)
    for preset in PRESET_NAMES:
        run_filter(name, recording, preset=preset, details=True, learn_bias=False)
        state = live_state(FILTERS[name], filter_parameters(name, preset=preset).kernel_params())
        for sample in samples_of(recording)[:3]:
            state.update(sample)
after = compiled()
print('compiled late:', [name for name in after if after[name] != before[name]])
"""


def test_every_kernel_is_compiled_ahead_for_the_types_of_real_data() -> None:
    command = [sys.executable, '-c', PROGRAM]
    folder = Path(__file__).parent
    found = subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder)
    assert found.stdout.splitlines() == ['left out: []', 'compiled late: []']
