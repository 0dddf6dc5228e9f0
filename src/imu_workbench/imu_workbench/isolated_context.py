# SPDX-License-Identifier: Apache-2.0
"""A ROS context that takes no part in discovery."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import rclpy
from rclpy.context import Context

DISCOVERY_VARIABLE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


@contextmanager
def quiet_context() -> Iterator[Context]:
    """Provide a context whose participants are outside of discovery, and shut it down.

    Contexts of one process would otherwise meet each other; Fast DDS can lock up when such
    participants leave while others still hear them.
    """
    context = Context()
    with _undiscovered():
        rclpy.init(args=[], context=context)
    try:
        yield context
    finally:
        rclpy.try_shutdown(context=context)


@contextmanager
def _undiscovered() -> Iterator[None]:
    before = os.environ.get(DISCOVERY_VARIABLE)
    os.environ[DISCOVERY_VARIABLE] = 'OFF'
    try:
        yield
    finally:
        if before is None:
            del os.environ[DISCOVERY_VARIABLE]
        else:
            os.environ[DISCOVERY_VARIABLE] = before
