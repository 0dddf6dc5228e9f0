# SPDX-License-Identifier: Apache-2.0
"""Spin a node that drives hardware: the first interrupt makes it safe, the second stops it."""

from __future__ import annotations

from typing import Any

import rclpy
from imu_recording.interrupts import Interrupts
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

LOOK_S = 0.05


def spin_until_over(node_class: Any, args: list[str] | None = None) -> int:
    """Run the node until its run ends or it is interrupted; return the process's exit code.

    The node has `exit_code` (None: go on), `in_charge`, `order(name)` and `stop_at_once()`.
    """
    interrupts = Interrupts()
    rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    node = None
    try:
        node = node_class()
        if node.get_parameter('autostart').value and not node.autostart():
            return 2
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        return _spin(node, executor, interrupts)
    finally:
        interrupts.ignore()
        if node is not None:
            if node.in_charge:
                node.stop_at_once()
            node.deactivated()
            node.destroy_node()
        rclpy.try_shutdown()


def _spin(node: Any, executor: Any, interrupts: Interrupts) -> int:
    obeyed = 0
    while True:
        executor.spin_once(timeout_sec=LOOK_S)
        if node.exit_code is not None:
            return int(node.exit_code)
        if obeyed and not node.in_charge:
            return 1
        if interrupts.count == obeyed:
            continue
        first, obeyed = obeyed == 0, interrupts.count  # copies of the first may be late
        if not node.in_charge:
            return 0
        if not first:
            node.get_logger().error('second interrupt: stand-by at once')
            node.stop_at_once()
            return 1
        node.get_logger().warning(
            'interrupted: to the safe temperature, then stop; interrupt again to stop at once'
        )
        node.order('abort')
