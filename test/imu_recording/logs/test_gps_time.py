# SPDX-License-Identifier: Apache-2.0
"""The date of a log from its receiver: weeks of the calendar, and only times that agree."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from imu_recording.logs.gps_time import power_on, unix_of_gps

START = datetime(2024, 3, 7, 12, tzinfo=UTC)
SINCE = np.arange(5, 65) * 1_000_000_000
"""Seconds of the log [ns]."""
TOLD = START.timestamp() + SINCE * 1e-9
FIX = np.full(60, 3)


def test_gps_weeks_are_weeks_since_the_sixth_of_january_1980() -> None:
    monday = datetime(1980, 1, 6, tzinfo=UTC) + timedelta(weeks=2300, days=1)
    ahead = 18.0  # GPS time knows no leap seconds
    assert unix_of_gps(2300, 86_400_000) == pytest.approx(monday.timestamp() - ahead, abs=1e-3)
    assert np.diff(unix_of_gps([2300, 2300], [0, 1500])) == pytest.approx([1.5])


def test_the_log_was_switched_on_before_its_first_fix() -> None:
    assert power_on(SINCE, TOLD, FIX) == round(START.timestamp()) * 1_000_000_000


def test_single_wrong_times_and_those_without_a_fix_do_not_count() -> None:
    wrong = TOLD.copy()
    wrong[:20] += 1e4
    status = FIX.copy()
    status[:10] = 1
    expected = START.timestamp() * 1e9
    assert power_on(SINCE, wrong, status) == pytest.approx(expected, abs=1e3)


@pytest.mark.parametrize(
    ('told', 'fix'),
    [
        (TOLD, np.ones(60)),  # no fix
        (np.zeros(60), FIX),  # no date
        (TOLD - 20 * 365 * 86_400, FIX),  # 2004: a rollover of the week number
        (TOLD + 100.0 * np.arange(60), FIX),  # a clock that runs away
    ],
)
def test_what_no_receiver_tells_is_not_made_up(told: np.ndarray, fix: np.ndarray) -> None:
    assert power_on(SINCE, told, fix) is None
