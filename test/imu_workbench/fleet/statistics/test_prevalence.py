# SPDX-License-Identifier: Apache-2.0
"""Many devices name an effect that none of them shows alone."""

from __future__ import annotations

import numpy as np
from imu_workbench.fleet.statistics.prevalence import DEVICE_SHARES, joint_evidence


def test_thirty_devices_name_what_none_shows_alone() -> None:
    draw = np.random.default_rng(4)
    has = np.arange(30) < 24
    delta_chi2 = draw.chisquare(3, (30, 1)) * np.where(has, 3.0, 1.0)[:, None]  # g = 2
    joint, single = joint_evidence(delta_chi2, 3)
    assert np.median(single.max(axis=2)) < 3.0
    assert joint.max() > 5.0
    weight = np.exp(joint - joint.max()).sum(axis=(0, 1))
    assert 0.5 < weight @ DEVICE_SHARES / weight.sum() < 1.0
    nothing, _ = joint_evidence(draw.chisquare(3, (30, 1)), 3)
    assert np.log(np.exp(nothing).mean()) < 0.0
