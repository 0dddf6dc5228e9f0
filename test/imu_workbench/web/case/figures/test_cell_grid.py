# SPDX-License-Identifier: Apache-2.0
"""Cells of a map for the keyboard: a label each, the worst first."""

from __future__ import annotations

from imu_workbench.web.case.figures.cell_grid import cell_labels, first_cell
from imu_workbench.web.case.figures.failure_map import FailureMap
from imu_workbench.web.case.view import Place

UP, DOWN = Place('run a', 'ramp_up', 1), Place('run a', 'ramp_down', 1)
EMPTY = Place('run b', 'ramp_up', 2)
MAP = FailureMap(
    rows=('up', 'down'),
    columns=(('run a', 'R1'), ('run a', ''), ('run b', 'R2')),
    places=((UP, None, EMPTY), (DOWN, None, None)),
    ratio=((2.04, None, None), (7.96, None, 3.0)),
)


def test_only_cells_with_a_number_are_named_and_one_is_chosen() -> None:
    labels = cell_labels(MAP, UP)
    assert list(labels) == [UP, DOWN]
    assert labels[UP] == (f'{UP}: 2.0 × the noise floor', True)
    assert labels[DOWN] == (f'{DOWN}: 8.0 × the noise floor', False)


def test_the_tab_key_goes_to_what_is_chosen_else_to_the_worst() -> None:
    assert first_cell(MAP, None) == DOWN
    assert first_cell(MAP, UP) == UP


def test_without_a_map_there_is_nothing_to_go_to() -> None:
    assert cell_labels(None, UP) == {}
    assert first_cell(None, None) is None
    assert first_cell(FailureMap((), (), (), ()), None) is None
