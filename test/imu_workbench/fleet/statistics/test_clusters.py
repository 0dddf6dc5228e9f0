# SPDX-License-Identifier: Apache-2.0
"""The mixture finds as many clusters as devices were drawn from."""

from __future__ import annotations

import numpy as np
from imu_workbench.fleet.statistics.clusters import find_clusters

from .drawn_devices import MIX, vectors


def test_clusters_are_found_not_told() -> None:
    draw = np.random.default_rng(3)
    centres = draw.normal(0.0, 6.0, (6, 3))
    own = draw.integers(6, size=180)
    fleet = vectors(centres[own] + draw.normal(size=(180, 3)) @ MIX.T, own * 0.0, ['A'] * 180)
    found = find_clusters([fleet], [True] * 180)
    assert found.count == 6
    share = [np.unique(own[found.label == k], return_counts=True)[1].max() for k in range(6)]
    assert sum(share) > 0.97 * 180
    one = vectors(draw.normal(size=(180, 3)), np.zeros(180), ['A'] * 180)
    assert find_clusters([one], [True] * 180).count == 1
