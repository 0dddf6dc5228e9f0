# SPDX-License-Identifier: Apache-2.0
"""numba where it is installed; without it the same undecorated functions run, slower.

Compiled kernels are kept on disk until their file, a kernel's file they import from, or a
constant they import changes (`jit_cache`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from imu_recording import jit_cache

F = TypeVar('F', bound=Callable[..., Any])

try:
    import numba as _numba
    from numba.extending import register_jitable as _register_jitable
except ImportError:
    _numba = None

NUMBA: bool = _numba is not None
"""Whether kernels are compiled; diagnostics say so where they are not."""

_KERNELS: list[Any] = []


def njit(*arguments: Any, **options: Any) -> Any:
    """Compile a module-level kernel: `@njit` or `@njit(cache=True)`; a no-op without numba."""
    if len(arguments) == 1 and callable(arguments[0]) and not options:
        return _compiled(arguments[0], {'cache': True})

    def decorate(function: F) -> F:
        return _compiled(function, {'cache': True, **options})

    return decorate


def inline(**options: Any) -> Callable[[F], F]:
    """Let kernels call a function: compiled into them, plain Python to everybody else.

    It costs no compiled entry of its own, which is most of what small kernels cost to compile.
    """

    def decorate(function: F) -> F:
        if _numba is None:
            return function
        jit_cache.note(function, options)
        made: F = _register_jitable(no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)(
            function
        )
        return made

    return decorate


def compiled_here() -> list[str]:
    """Return the kernels this process had to compile because no cache held them."""
    return [
        f'{kernel.py_func.__module__}.{kernel.py_func.__qualname__}'
        for kernel in _KERNELS
        if sum(kernel.stats.cache_misses.values())
    ]


def _compiled(function: F, options: dict[str, Any]) -> F:
    if _numba is None:
        return function
    jit_cache.note(function, options)
    try:
        with jit_cache.locators():
            compiled: F = _numba.njit(no_cfunc_wrapper=True, **options)(function)
    except RuntimeError:  # nowhere to write: neither beside the file nor in the user's cache
        compiled = _numba.njit(no_cfunc_wrapper=True, **{**options, 'cache': False})(function)
    _KERNELS.append(compiled)
    return compiled
