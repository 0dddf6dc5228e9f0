# SPDX-License-Identifier: Apache-2.0
"""Spin a node that drives hardware: the first interrupt makes it safe, the second stops it."""

from __future__ import annotations

from collections.abc import Callable

from imu_recording.interrupts import Interrupts

from chamber_profile.commanded_node import CommandedNode


def spin_until_over(node: CommandedNode, look: Callable[[], None], interrupts: Interrupts) -> int:
    """Run the node until its run ends or it is interrupted; return the process's exit code."""
    obeyed = 0
    while True:
        look()
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
