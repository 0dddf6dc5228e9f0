# SPDX-License-Identifier: Apache-2.0
"""Cells as numbers: signs, missing values, lines as editors count them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.recording import BagError
from imu_recording.tables.csv_table import read_table
from imu_recording.tables.mapping import CsvMapping
from imu_recording.tables.row_range import RowRange

SECONDS = CsvMapping((), 't', 's')
COMMA = CsvMapping((), 't', 's', delimiter=';', decimal=',')


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'log.csv'


def test_a_minus_before_a_name_turns_the_sign_and_empty_cells_are_nan(file: Path) -> None:
    file.write_text('t, a, b\n0, 1, 2\n1, N/A, -inf\n\n2, 3,\n')
    table, notes = read_table(file, SECONDS, ['t', '-b', 'a'])
    np.testing.assert_array_equal(table, [[0, -2, 1], [1, np.inf, np.nan], [2, np.nan, 3]])
    assert notes == []


def test_lines_are_counted_as_editors_do_and_odd_ones_left_out(file: Path) -> None:
    file.write_text('t,a\n0,1\n1,2,3\n2,3\n3,4\n')
    table, notes = read_table(file, SECONDS, ['a'], RowRange(first_line=3, last_line=4))
    assert table.tolist() == [[3.0]]
    assert notes == ['1 lines do not have 2 cells and are left out (first: line 3)']


@pytest.mark.parametrize(
    ('mapping', 'text', 'said'),
    [
        (SECONDS, '', 'the file is empty'),
        (SECONDS, 't,gyro\n0,1\n', "no column 'a'; it has t, gyro"),
        (SECONDS, 't;a\n0;1\n', "is the delimiter ';'"),
        (SECONDS, 't,a\n0,1\n1,oops\n', "line 3, column 'a': 'oops' is no number; correct it"),
        (SECONDS, 't,a\n0,"1,5"\n', 'is the decimal sign a comma'),
        (COMMA, 't;a\n0;1,5x\n', "line 2, column 'a': '1,5x' is no number"),
        (CsvMapping((), 't', 'iso8601'), 't,a\nnoon,1\n', "'noon' is no date; write dates as"),
    ],
)
def test_what_is_no_number_is_named_with_its_place(
    file: Path, mapping: CsvMapping, text: str, said: str
) -> None:
    file.write_text(text)
    with pytest.raises(BagError) as refused:
        read_table(file, mapping, ['t', 'a'])
    assert str(refused.value).startswith(str(file))
    assert said in str(refused.value)
