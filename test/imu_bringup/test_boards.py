# SPDX-License-Identifier: Apache-2.0
"""A file of boards gives each its arguments, or says in a line what is wrong with it."""

from pathlib import Path

import pytest
from imu_bringup.boards import BOARD_ARGUMENTS, BoardsError, boards_of

GIVEN = {name: default for name, (default, _) in BOARD_ARGUMENTS.items()} | {'boards': ''}


def of(tmp_path: Path, text: str, **given: str) -> list[dict[str, object]]:
    file = tmp_path / 'boards.yaml'
    file.write_text(text)
    return boards_of({**GIVEN, **given, 'boards': str(file)})


def test_without_a_file_there_is_one_board() -> None:
    (board,) = boards_of({**GIVEN, 'transport': 'tcp://a:1', 'record': 'run'})
    assert board == {
        **{name: GIVEN[name] for name in BOARD_ARGUMENTS},
        'transport': 'tcp://a:1',
        'record': 'run',
    }


def test_boards_have_their_own_arguments_frames_and_bags(tmp_path: Path) -> None:
    text = (
        'left: {transport: "tcp://a:1"}\nright: {filter: both, frame_id: mast, record: r}\nrear:'
    )
    left, right, rear = of(tmp_path, text, record='run', model='m.yaml')
    assert [b['namespace'] for b in (left, right, rear)] == ['left', 'right', 'rear']
    assert [b['frame_id'] for b in (left, right, rear)] == [
        'left_imu_link',
        'mast',
        'rear_imu_link',
    ]
    assert [b['record'] for b in (left, right, rear)] == ['run_left', 'r', 'run_rear']
    assert [b['filter'] for b in (left, right, rear)] == ['ahrs', 'both', 'ahrs']
    assert left['transport'] == 'tcp://a:1'
    assert {b['model'] for b in (left, right, rear)} == {'m.yaml'}


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('just text', 'no boards, expected NAMESPACE: {ARGUMENT: VALUE, …}'),
        ('', 'no boards, expected NAMESPACE'),
        ('[dut1, dut2]', 'no boards, expected NAMESPACE'),
        ('dut1: tcp://a:1', "dut1 is 'tcp://a:1', expected NAMESPACE"),
        ('dut1: {trnsport: x}', 'dut1 has trnsport, expected one of namespace, transport'),
        ('dut1: {', 'no YAML, expected NAMESPACE'),
    ],
)
def test_a_wrong_file_is_told_in_a_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BoardsError) as refused:
        of(tmp_path, text)
    assert said in str(refused.value)
    assert 'boards.yaml' in str(refused.value)
    assert '\n' not in str(refused.value)


def test_a_file_that_is_not_there_is_named() -> None:
    with pytest.raises(BoardsError, match=r'boards:=none\.yaml: No such file'):
        boards_of({**GIVEN, 'boards': 'none.yaml'})
