# SPDX-License-Identifier: Apache-2.0
"""The published tables of Betta et al. 2022."""

import pytest
from imu_workbench.tables import paper


def test_the_published_tables_are_complete() -> None:
    rows = paper.tables_3_4_5()
    assert len(rows) == 3 * 9 * 5
    assert {row['segment'] for row in rows} == set(paper.SEGMENTS)
    ranges = {
        name: max(r['max'] - r['min'] for r in rows if r['quantity'].startswith(name))
        for name in paper.OVERALL_RANGES
    }
    assert ranges['magnetometer'] == pytest.approx(132.01)
    angles = paper.tables_6_7()
    assert len(angles) == 2 * 3 * 2 * 3
    assert {row['euler_angle'] for row in angles} == set(paper.ANGLES)
