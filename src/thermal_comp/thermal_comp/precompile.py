# SPDX-License-Identifier: Apache-2.0
"""Compile every kernel of fit, compare, diagnose and the node, so that none of them has to wait.

`python -m thermal_comp.precompile` fills numba's cache: seconds once instead of in the first fit.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from imu_recording import ImuRecording, read_bag, write_bag
from thermal_comp.data.defective_rows import far_rows
from thermal_comp.effects.operators import follow, grow_and_melt, play
from thermal_comp.linear.gaussian_evidence import CoefficientPrior, conditioned, joint_evidence
from thermal_comp.linear.product_table import ProductTable
from thermal_comp.linear.whitening import apply_gains, apply_transposed, innovation_gains
from thermal_comp.model.values import NoiseModel

COMPILED_BAG_FORMATS = (('mcap', 'zstd'), ('mcap', 'none'), ('sqlite3', 'none'))
"""Storage and compression of bags whose reading takes kernels of its own."""
EXAMPLE_ROWS = 20
"""Samples of the example that is compiled with."""


def precompile() -> None:
    """Call each cached kernel once with the types and layouts of real data."""
    time = np.linspace(0.0, 60.0, EXAMPLE_ROWS)
    values = np.linspace(-5.0, 5.0, EXAMPLE_ROWS)
    play(values, 1.0)
    follow(time, values, 10.0)
    grow_and_melt(time, values, 10.0, 10.0)
    far_rows(np.ones((EXAMPLE_ROWS, 3)), np.ones(3))
    noise = NoiseModel(np.ones(3), np.array([60.0, 600.0]), np.ones((2, 3)))
    slot = np.delete(np.arange(EXAMPLE_ROWS + 1, dtype=np.int64), 3)
    gains = innovation_gains(slot, noise, 0, 3.0)
    apply_transposed(apply_gains(values[:, None], gains), gains)
    prior = CoefficientPrior((0,), shared=False, deviation=np.ones(1))
    table = ProductTable(1)
    table.settle(table.append([np.ones((1, 3, 1))]), np.ones((3, 1)))
    joint_evidence(*table.products_among([0]), 3.0, 3, [prior])
    state = conditioned(*table.products([0]), 3.0, 3, [prior])
    state.evidences(np.zeros((1, 1), dtype=np.int64), np.ones(1), shared=False)
    recording = _recording()
    with tempfile.TemporaryDirectory() as folder:
        for storage, compression in COMPILED_BAG_FORMATS:
            path = Path(folder) / f'{storage}_{compression}'
            write_bag(recording, path, storage=storage, compression=compression)
            read_bag(path)


def _recording() -> ImuRecording:
    """Return a few samples with every kind of topic."""
    tracks = np.ones((EXAMPLE_ROWS, 3))
    return ImuRecording(
        stamp=np.arange(EXAMPLE_ROWS, dtype=np.int64) * 10_000_000 + 1_700_000_000_000_000_000,
        angular_velocity=tracks,
        linear_acceleration=tracks,
        magnetic_field=tracks,
        temperature=np.linspace(20.0, 21.0, EXAMPLE_ROWS),
        heater=np.linspace(0.0, 1.0, EXAMPLE_ROWS),
        vibration=tracks,
        up_axis='+z',
    )


def main() -> int:
    """Fill the cache."""
    precompile()
    return 0


if __name__ == '__main__':
    sys.exit(main())
