# SPDX-License-Identifier: Apache-2.0
"""Samples missing between stamps."""

from __future__ import annotations

from imu_recording.ros.losses import StampGaps


def test_another_rate_is_no_loss() -> None:
    gaps = StampGaps()
    stamp = 0
    for step in [10] * 50 + [25] * 60 + [50] + [25] * 3 + [20_000_000_000] + [25] * 3:
        stamp += step
        gaps.add(stamp)
    assert gaps.missing == 1


def test_stamps_in_bursts_tell_no_loss() -> None:
    gaps = StampGaps()
    for burst in range(100):
        for sample in range(4):
            gaps.add(8_000_000 * burst + 100_000 * sample)
    assert gaps.missing == 0
