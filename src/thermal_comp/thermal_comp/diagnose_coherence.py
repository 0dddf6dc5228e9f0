# SPDX-License-Identifier: Apache-2.0
"""Do the axes of a sensor share a course that sensor noise cannot have in common?"""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnose_bank import ColumnBank

SCALES = (4, 16, 64)
"""Numbers of consecutive whitened rows that are summed."""


def coherence_evidence(bank: ColumnBank) -> float:
    """Return the strongest evidence over the scales: n Σ ρ² − 3 ln n, ρ between axes.

    The whitened residuals of independent noise are independent between the axes; a supply that
    was not logged, or another common cause, moves them together.
    """
    best = -np.inf
    for scale in SCALES:
        summed = np.concatenate(
            [_sums(bank.target[:, bank.run_of_row == run], scale) for run in _runs(bank)], axis=1
        )
        count = summed.shape[1]
        if count < 20:
            continue
        correlation = np.corrcoef(summed)
        pairs = correlation[np.triu_indices(3, 1)]
        best = max(best, float(count * (pairs**2).sum() - 3.0 * np.log(count)))
    return best


def _runs(bank: ColumnBank) -> list[int]:
    return [int(run) for run in np.unique(bank.run_of_row)]


def _sums(values: FloatArray, scale: int) -> FloatArray:
    """(3, n) → (3, n // scale) sums of consecutive values."""
    count = values.shape[1] // scale
    return np.asarray(values[:, : count * scale].reshape(3, count, scale).sum(axis=2))
