# SPDX-License-Identifier: Apache-2.0
"""A publisher for replay and tests: nothing is sent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class CapturedPublisher:
    """Stands in for a publisher: hands every message to a function instead of DDS."""

    def __init__(self, topic: str, capture: Callable[[str, Any], None]) -> None:
        self.topic_name = topic
        self._capture = capture

    def publish(self, message: Any) -> None:
        """Hand the message over."""
        self._capture(self.topic_name, message)
