# SPDX-License-Identifier: Apache-2.0
"""Compile the kernels of this package: python -m orientation_filters.precompile.

Compiled kernels stay on disk; afterwards filters start at once, live and over recordings. Only
`update` of a filter, called from Python sample by sample, is compiled at its first call.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import replace
from math import nan

import numpy as np
from imu_recording.jit import compiled_here
from imu_recording.recording import SECOND_NS
from imu_recording.ros.messages import ImuSample, MagneticSample

from imu_recording import ImuRecording
from orientation_filters.filters import FILTERS, filter_parameters, run_filter
from orientation_filters.live.filter import LiveFilter
from orientation_filters.parameters import PRESET_NAMES
from orientation_filters.sample_checks import GRAVITY
from orientation_filters.upsampling import upsample


def precompile(filters: Iterable[str] = FILTERS) -> list[str]:
    """Run filters, live and over a recording; return the kernels that had to be compiled."""
    recording = at_rest(3)
    upsample(replace(recording, stamp=100 * recording.stamp))
    for name in filters:
        for preset in PRESET_NAMES:
            run_filter(name, recording, preset=preset)
            live = LiveFilter(name, filter_parameters(name, preset=preset))
            for stamp in recording.stamp.tolist():
                live.add_field(MagneticSample(stamp, (2e-5, 0.0, -4e-5)))
                live.add_imu(ImuSample(stamp, (0.0, 0.0, 0.0), (0.0, 0.0, GRAVITY)))
    return [kernel for kernel in compiled_here() if kernel.startswith('orientation_filters.')]


def at_rest(rows: int) -> ImuRecording:
    """Return a sensor lying flat, the last row without a magnetometer sample."""
    field = np.tile([2e-5, 0.0, -4e-5], (rows, 1))
    field[-1] = nan
    return ImuRecording(
        stamp=SECOND_NS + 10_000_000 * np.arange(rows),
        angular_velocity=np.zeros((rows, 3)),
        linear_acceleration=np.tile([0.0, 0.0, GRAVITY], (rows, 1)),
        magnetic_field=field,
        temperature=np.full(rows, 20.0),
    )


def main() -> int:
    """Compile, and print how many kernels were not on disk yet."""
    sys.stdout.write(f'orientation_filters: {len(precompile())} kernels compiled\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
