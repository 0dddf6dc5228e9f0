# SPDX-License-Identifier: Apache-2.0
"""When the level of a sensor may have stepped: where a matched filter responds most."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnose_bank import ColumnBank

CANDIDATES = 2
"""Steps per run that are handed on."""
APART_S = 1200.0
"""Least distance of two of them [s]."""


def step_times(bank: ColumnBank) -> list[tuple[int, float]]:
    """Return run and time [s] of the likeliest steps, each run's strongest first.

    A step at row t is the column H_t = (0 … 0, 1 … 1); with W the whitening filter its product
    with the residual r is H_tᵀ Wᵀ W r, a sum over the rows from t on. Its norm hardly depends on
    t, as a whitening filter soon forgets a step.
    """
    found = []
    for number, run in enumerate(bank.source.runs):
        time = run.time[bank.valid[number]]
        response = np.cumsum(bank.transposed(number)[::-1], axis=0)[::-1]
        strength: FloatArray = (response**2).sum(axis=1)
        for _ in range(CANDIDATES):
            at = int(np.argmax(strength))
            if not 0 < at < len(time) or strength[at] <= 0.0:
                break
            found.append((number, float(0.5 * (time[at - 1] + time[at]))))
            strength[np.abs(time - time[at]) < APART_S] = 0.0
    return found
