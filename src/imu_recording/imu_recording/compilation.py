# SPDX-License-Identifier: Apache-2.0
"""Listeners for the first compilation of a kernel in this process, kept apart from numba.

A node may load its first kernels long after it was started: a driver does for a simulated board.
"""

from __future__ import annotations

from collections.abc import Callable

COMPILATION_LISTENERS: list[Callable[[], None]] = []
"""Called once, before the first kernel that no cache holds is compiled (`imu_recording.jit`)."""
