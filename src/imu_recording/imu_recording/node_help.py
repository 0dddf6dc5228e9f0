# SPDX-License-Identifier: Apache-2.0
"""What an executable answers to --help: what it does, its parameters, how to give them."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import Field, fields
from inspect import cleandoc
from pathlib import Path
from typing import Any

from imu_recording.node_config import NodeConfig
from imu_recording.parameter import default_of, listed

WIDTH = 96


def asks_for_help(arguments: Sequence[str]) -> bool:
    """Tell whether a command line (program first) asks what can be given.

    >>> asks_for_help(['ahrs_filter_node', '-h']), asks_for_help(['ahrs_filter_node'])
    (True, False)
    """
    return any(argument in ('-h', '--help') for argument in arguments[1:])


def node_help(node_class: Any, program: str) -> str:
    """Return the help of a node class that has `config_class`; `program` is its executable."""
    package = node_class.__module__.partition('.')[0]
    meaning = cleandoc(node_class.__doc__ or '')
    shared = {item.name for item in fields(NodeConfig)}
    own = [item for item in fields(node_class.config_class) if item.name not in shared]
    parameters = '\n'.join(map(_parameter, [*own, *fields(NodeConfig)]))
    return (
        f'usage: ros2 run {package} {Path(program).name} [--ros-args [-p PARAMETER:=VALUE] …\n'
        '       [--params-file FILE] [-r TOPIC:=OTHER] … [-r __ns:=/SPACE] [-r __node:=NAME]]\n'
        f'\n{meaning}\n\nParameters (* may be set while the node is active):\n{parameters}\n'
    )


def _parameter(item: Field[Any]) -> str:
    about = item.metadata
    allowed = ''
    if about['bounds']:
        low, high = about['bounds']
        allowed = f', {_shown(low)} … {_shown(high)}'
    choices = f'; one of {listed(about["choices"])}' if about['choices'] else ''
    unit = f' [{about["unit"]}]' if about['unit'] else ''
    mark = ' *' if about['dynamic'] else ''
    text = f'{about["description"]}{unit}{allowed}{choices}'
    indent = ' ' * 6
    told = textwrap.fill(text, WIDTH, initial_indent=indent, subsequent_indent=indent)
    return f'  {item.name}:={_shown(default_of(item))}{mark}\n{told}'


def _shown(value: Any) -> str:
    """Return a default as it is written after `:=`."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f'[{", ".join(map(_shown, value))}]'
    if isinstance(value, float):
        return f'{value:.12g}'
    return "''" if value == '' else str(value)
