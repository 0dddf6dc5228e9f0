# SPDX-License-Identifier: Apache-2.0
"""Only a change of the time axis is a zoom of the plots."""

from __future__ import annotations

from imu_workbench.web.case.centre import window_of


def test_only_a_change_of_the_time_axis_is_a_zoom():
    assert window_of({'xaxis3.range[0]': 2, 'xaxis3.range[1]': 3}) == (2.0, 3.0)
    assert window_of({'xaxis.range': [1, 2]}) == (1.0, 2.0)
    assert window_of({'xaxis.autorange': True}) is None
    assert window_of({'autosize': True}) == ()
