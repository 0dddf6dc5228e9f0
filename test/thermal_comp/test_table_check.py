# SPDX-License-Identifier: Apache-2.0
"""Tables are judged by their own numbers."""

from dataclasses import replace
from pathlib import Path

import pytest
from thermal_comp.table_check import Row, TableError, check_rows, read_table

SOUND = Row('A', 'accelerometer', 'm/s^2', 'x', 'R1', 9.7, 9.9, 9.8, 0.03)


@pytest.mark.shared_data
def test_the_published_tables_give_themselves_away(shared: Path) -> None:
    findings = check_rows(read_table(shared / 'reference' / 'tables_3_4_5.csv'))
    found = {(f.name, place) for f in findings for place in f.where}
    assert ('impossible_statistic', 'DUT1 magnetometer z R4') in found
    assert ('impossible_statistic', 'DUT2 gyroscope z reference') in found
    assert ('spikes', 'DUT1 gyroscope x R4') in found
    assert ('orientation_flip', 'DUT2 accelerometer y R4') in found
    names = {name for name, _ in found}
    assert {'startup_transient', 'unit_mismatch', 'field_jump', 'repeated_columns'} <= names
    assert any('44 σ' in f.text for f in findings)
    assert all(len(f.explanations) >= 1 for f in findings)


def test_a_sound_row_is_left_alone_and_an_impossible_one_is_not() -> None:
    assert check_rows([SOUND]) == []
    assert check_rows([replace(SOUND, mean=9.95)])[0].name == 'impossible_statistic'
    assert check_rows([replace(SOUND, std=0.25)])[0].name == 'impossible_statistic'


def test_a_table_without_a_column_is_refused(tmp_path: Path) -> None:
    path = tmp_path / 'table.csv'
    path.write_text('dut,axis\nA,x\n')
    with pytest.raises(TableError, match='quantity'):
        read_table(path)
