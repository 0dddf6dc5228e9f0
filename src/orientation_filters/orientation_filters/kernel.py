# SPDX-License-Identifier: Apache-2.0
"""Compilation of kernels: inlined into the loop that calls them, without division checks.

Inlining keeps a filter's state in registers; called, it would be copied at every step. `inline` is
for functions that only kernels call, `kernel` for functions that Python calls.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from imu_recording import jit

F = TypeVar('F', bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a kernel for Python to call."""
    compiled: F = jit.njit(error_model='numpy', forceinline=True)(function)
    return compiled


def inline(function: F) -> F:
    """Let kernels call the function, compiled into them; it may make no array or list.

    Tuples of numbers need no reference counts: left out, compilation takes a sixth less time.
    """
    made: F = jit.inline(error_model='numpy', forceinline=True, _nrt=False)(function)
    return made
