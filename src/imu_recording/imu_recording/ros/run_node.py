# SPDX-License-Identifier: Apache-2.0
"""Run a node of this workspace as a process: what every `ros2 run` executable calls.

While a node runs, Ctrl-C and SIGTERM are counted instead of raised wherever the program happens to
be: a KeyboardInterrupt inside a message callback can surface as any error of the C++ layer below.
While it starts there are no callbacks yet: they are raised, and end a minute of compilation at
once.
"""

from __future__ import annotations

import faulthandler
import gc
import os
import re
import signal
import sys
import textwrap
import time
from collections.abc import Callable, Sequence
from dataclasses import Field, fields
from functools import partial
from inspect import cleandoc
from pathlib import Path
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import UnknownROSArgsError
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from imu_recording.compilation import COMPILATION_LISTENERS
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.parameter import NodeConfig, default_of, listed
from imu_recording.user_error import UserError

DEBOUNCE_S = 0.4
"""Ctrl-C reaches a launched node twice within this time: still one interrupt [s]."""
INTERRUPT_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """Counts SIGINT and SIGTERM from its construction on; close together they count once.

    Until `begin_to_count` they raise KeyboardInterrupt as well.
    """

    def __init__(self) -> None:
        self.count = 0
        self._raises = True
        self._last = float('-inf')
        for number in INTERRUPT_SIGNALS:
            signal.signal(number, self._on_signal)

    def begin_to_count(self) -> None:
        """Only count from now on, so that what is under way ends first."""
        self._raises = False

    def ignore(self) -> None:
        """Ignore further interrupts while devices are released and files closed."""
        for number in INTERRUPT_SIGNALS:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, *_: object) -> None:
        now = time.monotonic()
        if now - self._last > DEBOUNCE_S:
            self.count += 1
        self._last = now
        if self._raises:
            raise KeyboardInterrupt


SPIN_TIMEOUT_S = 0.2
"""An interrupt is seen at most this long after it came [s]."""
RELEASE_TIMEOUT_S = 20.0
"""A middleware that has not let go of a released node by then is left behind [s]."""
STDERR = 2
REFUSED_EXIT_CODE = 2
"""Exit code where the arguments or, of a node with an end, the configuration are refused."""
UNCONFIGURED_ADVICE = (
    'unconfigured: set what is wrong (ros2 param set {0} …), then configure and activate '
    '(ros2 lifecycle set {1} configure)'
)

MIDDLEWARE_PROFILES = (
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    str(Path(__file__).with_name('fastdds.xml')),
)
"""Environment variable and file of Fast DDS, set unless the user has; no other middleware reads
it."""

Spin = Callable[[Any, Callable[[], None], Interrupts], int]
"""Runs a node until it is to end, calling the second argument over and over; the exit code."""


def run_node(
    node_class: Callable[[], ConfiguredNode],
    args: Sequence[str] | None = None,
    *,
    spin: Spin | None = None,
) -> int:
    """Run a node until Ctrl-C; return the process's exit code (2: refused).

    Arguments that cannot be read end it; a configuration that is refused leaves it unconfigured
    with the reason in its diagnostics. The ROS context lives until the node is released, so that
    its last messages still go out; where the middleware keeps hold of it, the process says where
    it stands and ends with exit code 1. `spin` is the loop of a node that ends in a way of its
    own, also by a refused configuration.
    """
    arguments = list(sys.argv if args is None else args)
    if asks_for_help(arguments):
        sys.stdout.write(node_help(node_class, arguments[0]))
        return 0
    node, interrupts = None, Interrupts()
    try:
        os.environ.setdefault(*MIDDLEWARE_PROFILES)
        COMPILATION_LISTENERS.append(partial(get_logger('imu_recording').info, COMPILING_MESSAGE))
        node = _new_node(node_class, arguments)
        if node.get_parameter('autostart').value and not node.autostart(interrupts.begin_to_count):
            if spin:
                return REFUSED_EXIT_CODE
            way = UNCONFIGURED_ADVICE.format(node.refuser, node.get_fully_qualified_name())
            node.get_logger().warning(way)
        interrupts.begin_to_count()
        gc.collect()
        gc.freeze()  # what was imported stays: no collection need look at it again
        return (spin or _until_interrupted)(node, _executor(node), interrupts)
    except UserError as error:
        sys.stderr.write(f'{error}; --help lists what can be given\n')
        return REFUSED_EXIT_CODE
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    finally:
        interrupts.ignore()
        if node is not None:
            node.end()
            faulthandler.dump_traceback_later(RELEASE_TIMEOUT_S, exit=True, file=STDERR)
        try:
            if node is not None:
                node.destroy_node()
            rclpy.try_shutdown()
        finally:
            faulthandler.cancel_dump_traceback_later()


def _new_node(node_class: Callable[[], ConfiguredNode], arguments: list[str]) -> ConfiguredNode:
    """Return the node under the names and parameters of a command line; refuse a wrong one."""
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        strays = remove_ros_args(arguments)[1:]
    except (RuntimeError, ValueError) as error:  # what rcl raises for arguments it cannot read
        raise UserError(_reason(error)) from None
    if strays:
        raise UserError(f'{" ".join(strays)}: expected --ros-args before parameters and remaps')
    try:
        return node_class()
    except (NameValidationException, ParameterException) as error:
        raise UserError(str(error)) from None


def _reason(error: Exception) -> str:
    """Return rcl's reason without its source lines and grammar."""
    if isinstance(error, UnknownROSArgsError):
        return f'unknown after --ros-args: {error}'
    reason = re.sub(r', at \S+:\d+', '', str(error)).removeprefix('failed to initialize rcl: ')
    rule, lexeme, _ = reason.partition('. Error: Expected lexeme')
    return f'{rule}; expected -p NAME:=VALUE or -r FROM:=TO' if lexeme else reason


def _executor(node: ConfiguredNode) -> Callable[[], None]:
    """Return a function that runs what is due; `spin_once`, as EventsExecutor.spin may hang."""
    executor: Any
    if node.event_driven:
        from rclpy.experimental.events_executor import EventsExecutor

        executor = EventsExecutor()
    else:
        executor = SingleThreadedExecutor()
    for each in (node, *node.hosted):
        executor.add_node(each)
    return partial(executor.spin_once, timeout_sec=SPIN_TIMEOUT_S)


def _until_interrupted(_: Any, look: Callable[[], None], interrupts: Interrupts) -> int:
    while not interrupts.count and rclpy.ok():
        look()
    return 0


COMPILING_MESSAGE = (
    'compiling the numerical kernels this node needs: once after a build, up to a minute; '
    'python -m imu_workbench.precompile compiles all of them ahead'
)
HELP_WIDTH = 96


def asks_for_help(arguments: Sequence[str]) -> bool:
    """Tell whether a command line (program first) asks for help.

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
    meaning = textwrap.fill(text, HELP_WIDTH, initial_indent=indent, subsequent_indent=indent)
    return f'  {item.name}:={_shown(default_of(item))}{mark}\n{meaning}'


def _shown(value: Any) -> str:
    """Return a default as it is written after `:=`."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f'[{", ".join(map(_shown, value))}]'
    if isinstance(value, float):
        return f'{value:.12g}'
    return "''" if value == '' else str(value)
