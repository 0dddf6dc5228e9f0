# SPDX-License-Identifier: Apache-2.0
"""Whitened rows of several runs, without what the runs' levels and a base model take up."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from thermal_comp.linear.columns import LEAST_NEW_LENGTH, orthonormal, project_out, stack_runs
from thermal_comp.linear.whitening import RowWhitening


class ProjectedRows:
    """Projection of columns over the rows of all runs, axis by axis."""

    def __init__(self, whitening: RowWhitening, base: Sequence[FloatArray]) -> None:
        """`base` (rows, 3, p) each: columns of a model beside the level of each run."""
        self.whitening = whitening
        rows = np.diff(whitening.edges)
        levels = stack_runs([np.ones((int(n), 3, 1)) for n in rows], per_run=True)
        known = np.concatenate([levels, *base], axis=2)
        self._base = [orthonormal(columns) for columns in whitening.whitened(known)]

    def projected(
        self, columns: FloatArray, least_share: float = LEAST_NEW_LENGTH
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return what is left (3, rows, p) of columns (rows, 3, p), and (3, p) what has been lost.

        Lost are columns of which no more is left than `least_share` of the whitened length.
        """
        whitened = self.whitening.whitened(columns)
        left = np.stack([project_out(*pair) for pair in zip(self._base, whitened, strict=True)])
        lost = np.linalg.norm(left, axis=1) <= least_share * np.linalg.norm(whitened, axis=1)
        return left, lost
