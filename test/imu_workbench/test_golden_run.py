# SPDX-License-Identifier: Apache-2.0
"""A golden run comes back as written; the first number that differs is named."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.golden_run import (
    Drift,
    GoldenColumns,
    GoldenError,
    columns_of,
    find_drift,
    read_golden,
    write_golden,
)


@dataclass(frozen=True)
class Published:
    """A message with two numbers."""

    received: int
    topic: str
    x: float

    def numbers(self) -> dict[str, float]:
        return {'x': self.x, 'twice': 2.0 * self.x}


@pytest.fixture
def columns() -> dict[str, GoldenColumns]:
    messages = [Published(10 * i, '/imu', float(i)) for i in range(5)]
    return columns_of([*messages, Published(0, '/diagnostics', 1.0)])


def test_numbers_come_back_and_diagnostics_are_left_out(columns, tmp_path: Path) -> None:
    write_golden(tmp_path / 'golden.json', columns, {'node': 'any'})
    again = read_golden(tmp_path / 'golden.json')
    assert list(again) == ['/imu']
    assert again['/imu'].names == ['x', 'twice']
    np.testing.assert_array_equal(again['/imu'].values, columns['/imu'].values)
    assert find_drift(columns, again, 0.0) is None


def test_the_first_number_that_moved_is_named(columns) -> None:
    values = columns['/imu'].values.copy()
    values[3:, 1] += 1e-6
    moved = {'/imu': GoldenColumns(columns['/imu'].time, columns['/imu'].names, values)}
    drift = find_drift(moved, columns, 1e-9)
    assert isinstance(drift, Drift)
    assert (drift.sample, drift.time, drift.field) == (3, 30, 'twice')
    assert find_drift(moved, columns, 1e-5) is None


def test_a_topic_that_is_gone_is_told(columns) -> None:
    assert find_drift({}, columns, 0.0) == '/imu: not published any more'


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'other.json').write_text('{"schema": 1}')
    with pytest.raises(GoldenError, match='is not a golden file'):
        read_golden(tmp_path / 'other.json')
