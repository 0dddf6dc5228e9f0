# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: inlined into the loop that calls them, without division checks.

Inlining keeps a filter's state in registers; called, it would be copied at every step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from imu_recording.jit import njit

F = TypeVar('F', bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a step that other kernels call; without numba it stays as it is."""
    compiled: F = njit(cache=True, error_model='numpy', forceinline=True)(function)
    return compiled
