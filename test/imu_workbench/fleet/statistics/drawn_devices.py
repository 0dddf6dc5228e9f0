# SPDX-License-Identifier: Apache-2.0
"""Devices of a fleet drawn from a known distribution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_workbench.fleet.statistics.vectors import Vectors

MIX = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.3, 0.2, 0.9]])
"""Axes of a lot correlate."""


def vectors(coefficients: np.ndarray, misfit: np.ndarray, lots: Sequence[str]) -> Vectors:
    """Return the slopes of a gyroscope, known to 0.01 each."""
    n = len(coefficients)
    return Vectors(
        sensor='gyroscope',
        unit='rad/s/K',
        device=np.array([f'd{k:05d}' for k in range(n)]),
        type=np.full(n, 'none'),
        lot=np.array(lots),
        coefficients=coefficients,
        std=np.full((n, 3), 0.01),
        run_std=np.full((n, 3), 0.01),
        runs=np.full(n, 3),
        misfit=misfit,
        measured_at=np.arange(n),
    )
