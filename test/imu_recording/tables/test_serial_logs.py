# SPDX-License-Identifier: Apache-2.0
"""Logs as a terminal or a table of numbers keeps them: without times, or names of columns."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from imu_recording.tables.csv_import import import_csv
from imu_recording.tables.mapping import MappingError, mapping_from


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_serial_log_without_header_and_times(tmp_path: Path) -> None:
    """As a terminal keeps it: it begins within a line, and a few cells are garbled."""
    mapping = {
        'schema': 1,
        'header': False,
        'time': {'rate': 10},
        'columns': {
            'temperature': {'column': 0, 'unit': '°C'},
            'linear_acceleration': {'columns': [1, 2, 3], 'unit': 'g'},
        },
    }
    rows = [f'{20 + k / 100},0,0,1' for k in range(200)]
    rows[100] = '21.0,0,0.0-0.1,1'
    rows[150] = '21.5,0,0'
    file = written(tmp_path / 'a.csv', '\n'.join(['=~=~= PuTTY log =~=~=', '0,1', *rows]))
    recording = import_csv(file, mapping)
    np.testing.assert_allclose(
        recording.stamp * 1e-9, [(k + 2) / 10 for k in range(200) if k not in (100, 150)]
    )
    np.testing.assert_allclose(recording.temperature[[0, 100, -1]], [20.0, 21.01, 21.99])
    assert '3 lines do not have 4 cells and are left out (first: line 1)' in recording.notes
    assert (
        "1 lines are garbled and left out (first: line 103, column '2': '0.0-0.1' is no number)"
        in recording.notes
    )


def test_a_column_without_a_name_is_a_column(tmp_path: Path) -> None:
    """As pandas writes its index."""
    columns = {'linear_acceleration': {'columns': ['x', 'y', 'z'], 'unit': 'g'}}
    mapping = {'schema': 1, 'time': {'column': '', 'unit': 's'}, 'columns': columns}
    file = written(tmp_path / 'a.csv', ',x,y,z\n0,0,0,1\n1,0,0,1\n2,0,0,1\n')
    assert import_csv(file, mapping).time.tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ('time', 'said'),
    [
        ({}, 'of a file without times the rate of its rows'),
        ({'rate': 0}, 'time: rate is 0, expected rows a second above 0'),
        ({'rate': 10, 'unit': 's'}, "'unit'"),
    ],
)
def test_what_is_wrong_with_the_time_of_a_mapping_is_said(
    time: dict[str, object], said: str
) -> None:
    columns = {'linear_acceleration': {'columns': ['x', 'y', 'z'], 'unit': 'g'}}
    with pytest.raises(MappingError, match=re.escape(said)):
        mapping_from({'schema': 1, 'time': time, 'columns': columns})
