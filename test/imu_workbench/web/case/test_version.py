# SPDX-License-Identifier: Apache-2.0
"""Parameters of a version with their uncertainty."""

from __future__ import annotations

from imu_workbench.web.case.version import parameter_text


def test_numbers_carry_their_uncertainty():
    assert parameter_text(79.41, 1.23) == '79.4 ± 1.2'
    assert parameter_text([1.0, 2.0], [0.1, 0.1]) == '1.00 ± 0.10, 2.00 ± 0.10'
