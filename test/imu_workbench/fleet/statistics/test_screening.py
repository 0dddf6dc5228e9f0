# SPDX-License-Identifier: Apache-2.0
"""Screening finds the devices that were drawn outside their lot, and few others."""

from __future__ import annotations

import string

import numpy as np
import pytest
from imu_workbench.fleet.statistics.screening import Screening, odd_devices, screen

from .drawn_devices import MIX, vectors


@pytest.mark.parametrize(('lots', 'seed'), [('AB', 2), (string.ascii_letters[:32], 11)])
def test_screening_finds_outliers_of_four_sigma_and_leaves_the_others_in_peace(
    lots: str, seed: int
) -> None:
    draw = np.random.default_rng(seed)
    values, misfit = draw.normal(size=(4000, 3)) @ MIX.T, 0.02 * draw.normal(size=4000)
    seeded, foreign = np.arange(0, 4000, 80), np.arange(40, 4000, 400)
    values[seeded, 1] = 4.0 * draw.choice([-1.0, 1.0], len(seeded))
    misfit[foreign] += 0.3
    fleet = vectors(values, misfit, np.repeat(list(lots), 4000 // len(lots)))
    screened = screen(fleet)
    odd = {one.device for one in odd_devices([(fleet, screened)] * 3)}  # level of three sensors
    wanted = {fleet.device[k] for k in (*seeded, *foreign)}
    assert len(odd & wanted) >= 0.95 * len(wanted)
    assert len(odd - wanted) <= 0.01 * (4000 - len(wanted))
    assert isinstance(screened, Screening)
