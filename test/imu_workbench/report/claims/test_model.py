# SPDX-License-Identifier: Apache-2.0
"""Tests of many channels together raise one false alarm in a hundred families."""

import doctest

import numpy as np
from imu_workbench.report.claims import model as claims_model
from imu_workbench.report.claims.model import rejected


def test_holm_keeps_the_family() -> None:
    assert doctest.testmod(claims_model).failed == 0
    rng = np.random.default_rng(5)
    alarms = sum(rejected(rng.uniform(size=27)).any() for _ in range(2000))
    assert alarms < 40  # one family in a hundred
    assert rejected([]).tolist() == []
