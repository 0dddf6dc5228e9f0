# SPDX-License-Identifier: Apache-2.0
"""Run a node of this workspace as a process: what every `ros2 run` executable calls."""

from __future__ import annotations

from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from imu_recording.interrupts import Interrupts
from imu_recording.lifecycle_node import ACTIVE, ConfiguredNode

LOOK_S = 0.1
"""An interrupt is seen at most this long after it came [s]."""


def run_node(node_class: Callable[[], ConfiguredNode], args: list[str] | None = None) -> int:
    """Run a node until Ctrl-C; return the process's exit code (2: configuration refused).

    The ROS context lives until the node is released, so that its last messages still go out.
    """
    interrupts = Interrupts()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    node = None
    try:
        node = node_class()
        if node.get_parameter('autostart').value and not node.autostart():
            return 2
        _spin(node, interrupts)
    except ExternalShutdownException:
        pass
    finally:
        interrupts.ignore()
        if node is not None:
            if node.state == ACTIVE:
                node.deactivated()
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def _spin(node: ConfiguredNode, interrupts: Interrupts) -> None:
    """Run callbacks until interrupted; `spin_once` in a loop, as EventsExecutor.spin may hang."""
    if node.event_driven:
        from rclpy.experimental.events_executor import EventsExecutor

        executor = EventsExecutor()
    else:
        executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not interrupts.count and rclpy.ok():
        executor.spin_once(timeout_sec=LOOK_S)
