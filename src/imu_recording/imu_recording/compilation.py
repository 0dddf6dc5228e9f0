# SPDX-License-Identifier: Apache-2.0
"""Who is told that this process begins to compile kernels; numba is not imported for it.

A node may load its first kernels long after it was started: a driver does for a simulated board.
"""

from __future__ import annotations

from collections.abc import Callable

TOLD: list[Callable[[], None]] = []
"""Called once, before the first kernel that no cache held is compiled (`imu_recording.jit`)."""
