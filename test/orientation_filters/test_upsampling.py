# SPDX-License-Identifier: Apache-2.0
"""Slow recordings become fast ones by straight lines, and holes stay holes."""

from dataclasses import replace

import numpy as np
import pytest
from orientation_filters.upsampling import upsample

from imu_recording import ImuRecording


def ramp(n: int = 60, period_s: float = 2.0) -> ImuRecording:
    """A recording whose every column is a straight line in time."""
    time = np.arange(n) * period_s
    line = time[:, None] * np.array([1.0, -2.0, 0.5])
    return ImuRecording(
        stamp=1_600_000_000_000_000_000 + np.round(time * 1e9).astype(np.int64),
        angular_velocity=line,
        linear_acceleration=line + 9.81,
        magnetic_field=line * 1e-6,
        temperature=20.0 + time,
        cycle=(time >= 60).astype(np.int64),
    )


def test_straight_lines_stay_straight() -> None:
    fast = upsample(ramp())
    assert len(fast) == 59 * 100 + 1
    assert set(np.diff(fast.stamp)) == {20_000_000}
    np.testing.assert_allclose(fast.angular_velocity[:, 0], fast.time, atol=1e-9)
    np.testing.assert_allclose(fast.temperature, 20.0 + fast.time, atol=1e-9)
    np.testing.assert_array_equal(fast.cycle, fast.time >= 60)
    assert '0.5 Hz to 50 Hz' in fast.notes[-1]


def test_a_gap_above_three_periods_has_no_rows() -> None:
    slow = ramp()
    slow = slow.rows(np.r_[0:20, 22:40, 43:60])  # 6 s are bridged, 8 s are not
    fast = upsample(slow)
    gaps = np.diff(fast.stamp) * 1e-9
    assert gaps.max() == pytest.approx(8.0)
    assert (gaps > 0.021).sum() == 1


def test_a_hole_in_the_magnetometer_alone_is_nan() -> None:
    slow = ramp()
    field = slow.magnetic_field.copy()
    field[30:35] = np.nan
    fast = upsample(replace(slow, magnetic_field=field))
    missing = np.isnan(fast.magnetic_field).any(axis=1)
    assert fast.time[missing].min() == pytest.approx(58.02)
    assert fast.time[missing].max() == pytest.approx(69.98)
    assert np.isfinite(fast.angular_velocity).all()


def test_a_fast_recording_is_untouched() -> None:
    fast = ramp(200, 0.0199)
    assert upsample(fast) is fast
