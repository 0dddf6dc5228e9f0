# SPDX-License-Identifier: Apache-2.0
"""An ahrs_filter_node that hears message objects, as most nodes in Python do: for live_chain.py.

python benchmarks/live_typed.py --ros-args …
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

from imu_recording.ros.run_node import run_node
from imu_recording.ros.sample_bytes import form_of
from orientation_filters.node import AhrsFilterNode


class TypedAhrsFilterNode(AhrsFilterNode):
    """Subscribes to messages instead of their bytes."""

    def sample_input(
        self, message_type: type, topic: str, callback: Callable[[Any], None]
    ) -> None:
        """Call back with the samples of messages."""
        from_message = form_of(message_type).from_message
        self.input(message_type, topic, lambda message: callback(from_message(message)))


if __name__ == '__main__':
    sys.exit(run_node(TypedAhrsFilterNode))
