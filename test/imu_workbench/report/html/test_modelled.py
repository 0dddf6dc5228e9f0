# SPDX-License-Identifier: Apache-2.0
"""Slopes on the page are in thousandths of the unit."""

from __future__ import annotations

from imu_workbench.report.html.modelled import slope_rows


def test_slopes_are_shown_in_thousandths() -> None:
    slope = {'device': 'dut1', 'sensor': 'gyroscope', 'slope': [2e-3, None, 0.0], 'cycles': 4,
             'uncertainty': [1e-5, None, None]}  # fmt: skip
    assert slope_rows([slope], 'gyroscope') == [['dut1', '2.000 ± 0.010', '–', '0', '4']]
    assert slope_rows([slope], 'magnetometer') == []
