# SPDX-License-Identifier: Apache-2.0
"""The boards of a launch: one by its arguments, or each of a file by namespace."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml
from imu_recording.user_error import UserError

BOARD_ARGUMENTS: Final = {
    'namespace': ('', 'Namespace of the board'),
    'transport': (
        '',
        'serial:///dev/…, tcp://host:port, simulated://dut1, bag://path; topic: another driver',
    ),
    'device': ('', 'Serial number that is accepted; empty: any'),
    'model': ('', 'Thermal model; empty: nothing is compensated'),
    'filter': ('ahrs', 'none, complementary, ahrs or both'),
    'record': ('', 'Folder of the bag; empty: nothing is recorded'),
    'frame_id': ('', 'Frame of the sensor; empty: imu_link, or <namespace>_imu_link'),
    'body_frame_id': ('', 'Frame of the orientation; empty: frame_id'),
    'world_frame_id': ('', 'Parent frame on /tf; empty: world'),
    'publish_tf': ('false', 'Whether the filter publishes world → body on /tf'),
}
"""Arguments of one board: default and meaning; a file of boards gives any of them for each."""
FILE_FORMAT: Final = 'NAMESPACE: {ARGUMENT: VALUE, …}'


class BoardsError(UserError):
    """A file of boards that cannot be used; the message names it and what was expected."""


def boards_of(given: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the arguments of each board, of launch arguments that name a file or one board.

    Raises BoardsError.
    """
    common = {name: given[name] for name in BOARD_ARGUMENTS}
    if not given['boards']:
        return [common]
    boards = []
    for namespace, own in _content(given['boards']).items():
        if unknown := sorted(own.keys() - BOARD_ARGUMENTS.keys()):
            known = ', '.join(BOARD_ARGUMENTS)
            raise BoardsError(
                f'{given["boards"]}: {namespace} has {unknown[0]}, expected one of {known}'
            )
        board = {**common, 'namespace': namespace, **own}
        board['frame_id'] = board['frame_id'] or f'{namespace}_imu_link'
        if common['record'] and not own.get('record'):
            board['record'] = f'{common["record"]}_{namespace}'
        boards.append(board)
    return boards


def value(text: object) -> str | bool:
    """Return a launch argument as a parameter: typed as YAML has it.

    >>> value('true'), value('dut1.yaml')
    (True, 'dut1.yaml')
    """
    return {'true': True, 'false': False}.get(str(text).lower(), str(text))


def _content(path: str) -> dict[str, dict[str, Any]]:
    try:
        content = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise BoardsError(f'boards:={path}: {error.strerror}') from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = ' '.join(str(error).split())
        raise BoardsError(f'{path}: no YAML, expected {FILE_FORMAT} ({reason})') from None
    if not isinstance(content, dict) or not content:
        raise BoardsError(f'{path}: no boards, expected {FILE_FORMAT}')
    for namespace, own in content.items():
        if not isinstance(own or {}, dict):
            raise BoardsError(f'{path}: {namespace} is {own!r}, expected {FILE_FORMAT}')
    return {str(namespace): own or {} for namespace, own in content.items()}
