# SPDX-License-Identifier: Apache-2.0
"""Listeners for the first compilation of a kernel in this process, without importing numba.

A node registers one at its start, though it may load its first kernels much later: a driver does
so for a simulated board.
"""

from __future__ import annotations

from collections.abc import Callable

COMPILATION_LISTENERS: list[Callable[[], None]] = []
"""Called once, before the first kernel that is in no cache is compiled (`imu_recording.jit`)."""
