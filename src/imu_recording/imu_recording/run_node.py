# SPDX-License-Identifier: Apache-2.0
"""Run a node of this workspace as a process: what every `ros2 run` executable calls."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import UnknownROSArgsError
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from imu_recording.interrupts import Interrupts
from imu_recording.lifecycle_node import ConfiguredNode
from imu_recording.node_help import asks_for_help, node_help
from imu_recording.user_error import UserError

LOOK_S = 0.05
"""An interrupt is seen at most this long after it came [s]."""
REFUSED = 2
"""Exit code where the arguments or the configuration are refused."""

Spin = Callable[[Any, Callable[[], None], Interrupts], int]
"""Runs a node until it is to end, calling the second argument over and over; the exit code."""


def run_node(
    node_class: Callable[[], ConfiguredNode],
    args: Sequence[str] | None = None,
    *,
    spin: Spin | None = None,
) -> int:
    """Run a node until Ctrl-C; return the process's exit code (2: refused).

    The ROS context lives until the node is released, so that its last messages still go out.
    `spin` is the loop of a node that ends in a way of its own.
    """
    arguments = list(sys.argv if args is None else args)
    if asks_for_help(arguments):
        sys.stdout.write(node_help(node_class, arguments[0]))
        return 0
    interrupts = Interrupts()
    node = None
    try:
        node = _new_node(node_class, arguments)
        if node.get_parameter('autostart').value and not node.autostart():
            return REFUSED
        return (spin or _until_interrupted)(node, _executor(node), interrupts)
    except UserError as error:
        sys.stderr.write(f'{error}; --help tells what can be given\n')
        return REFUSED
    except ExternalShutdownException:
        return 0
    finally:
        interrupts.ignore()
        if node is not None:
            node.end()
            node.destroy_node()
        rclpy.try_shutdown()


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
    """Return a call that runs what is next; `spin_once`, as EventsExecutor.spin may hang."""
    executor: Any
    if node.event_driven:
        from rclpy.experimental.events_executor import EventsExecutor

        executor = EventsExecutor()
    else:
        executor = SingleThreadedExecutor()
    executor.add_node(node)
    return partial(executor.spin_once, timeout_sec=LOOK_S)


def _until_interrupted(_: Any, look: Callable[[], None], interrupts: Interrupts) -> int:
    while not interrupts.count and rclpy.ok():
        look()
    return 0
