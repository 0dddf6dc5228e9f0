# SPDX-License-Identifier: Apache-2.0
"""check-tables: published statistics that cannot be, said once with what may explain them."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from imu_workbench.__main__ import main
from imu_workbench.commands import check_tables


def test_a_table_that_contradicts_itself_is_a_check_that_does_not_hold(tmp_path: Path) -> None:
    table = tmp_path / 'table.csv'
    head = 'dut,quantity,axis,segment,min,max,mean,std\n'
    table.write_text(head + 'd,acc [m/s²],x,R1,-0.1,0.1,0.0,0.01\n')
    assert main(['check-tables', str(table)]) == 0
    table.write_text(head + 'd,acc [m/s²],x,R1,-0.1,0.1,0.5,0.01\n')
    assert main(['check-tables', str(table)]) == 3


def test_an_explanation_stands_once_for_all_rows_it_is_of(tmp_path: Path) -> None:
    table = tmp_path / 'table.csv'
    rows = [f'd,acc [m/s²],{axis},R1,-0.1,0.1,0.5,0.01' for axis in 'xy']
    table.write_text('\n'.join(['dut,quantity,axis,segment,min,max,mean,std', *rows]))
    answer = check_tables.run(Namespace(table=table))
    head, *lines = answer.text.splitlines()
    assert head == f'{table}: 2 rows, 2 findings: impossible_statistic 2'
    assert [line.lstrip()[:6] for line in lines] == ['imposs', 'imposs', 'either']
    assert answer.content['verdict'] == 'data_quality'
    assert len(answer.content['findings']) == 2
