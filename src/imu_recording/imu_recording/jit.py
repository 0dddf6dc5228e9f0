# SPDX-License-Identifier: Apache-2.0
"""numba where it is installed; without it the same undecorated functions run, slower."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

F = TypeVar('F', bound=Callable[..., Any])

try:
    import numba as _numba
except ImportError:
    _numba = None

NUMBA: bool = _numba is not None
"""Whether kernels are compiled; diagnostics say so where they are not."""


def njit(*arguments: Any, **options: Any) -> Any:
    """Compile a module-level kernel: `@njit` or `@njit(cache=True)`; a no-op without numba."""
    if len(arguments) == 1 and callable(arguments[0]) and not options:
        return _compiled(arguments[0], {'cache': True})

    def decorate(function: F) -> F:
        return _compiled(function, {'cache': True, **options})

    return decorate


def _compiled(function: F, options: dict[str, Any]) -> F:
    if _numba is None:
        return function
    compiled: F = _numba.njit(**options)(function)
    return compiled
