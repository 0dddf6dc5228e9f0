# SPDX-License-Identifier: Apache-2.0
"""Rows of a table: rounding from the printed digits, norms of complete vectors, checks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from imu_workbench.tables.channels import flips, units
from imu_workbench.tables.rows import StatisticsRow, TableError, norms, read_table

UP = StatisticsRow(
    dut='A',
    quantity='accelerometer',
    unit='m/s^2',
    axis='z',
    segment='R1',
    low=9.7,
    high=9.9,
    mean=9.81,
    std=0.03,
)


def device(segment: str, up: str = 'z', gravity: float = 9.81) -> list[StatisticsRow]:
    return [
        replace(UP, axis=axis, segment=segment, mean=mean, low=mean - 0.1, high=mean + 0.1)
        for axis in 'xyz'
        for mean in (gravity if axis == up else 0.0,)
    ]


def test_norms_need_all_axes() -> None:
    assert norms(device('R1'), 'accelerometer') == {('A', 'R1'): pytest.approx(9.81)}
    assert norms(device('R1')[1:], 'accelerometer') == {}


def test_a_device_that_was_turned_over_is_found() -> None:
    steady = [row for segment in ('R1', 'R2', 'R3') for row in device(segment)]
    assert flips(steady) == []
    (found,) = flips([*steady, *device('R4', up='x')])
    assert 'R4' in found.text


def test_gravity_gives_a_wrong_unit_away() -> None:
    assert units(device('R1')) == []
    assert units(device('R1', gravity=1.0))


def test_a_file_that_is_no_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / 'other.csv').write_text('a,b\n1,2\n')
    with pytest.raises(TableError, match=r'other\.csv'):
        read_table(tmp_path / 'other.csv')
