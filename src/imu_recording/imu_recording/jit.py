# SPDX-License-Identifier: Apache-2.0
"""Compile kernels with numba and keep them on disk, never older than their sources.

numba itself compares the file of a kernel alone. Kernels and constants of other files are compiled
into it, too: every version of a file and of what it imports for its kernels has a cache folder of
its own.
"""

from __future__ import annotations

import fcntl
import hashlib
import inspect
import os
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
from numba.core.event import Listener, register
from numba.extending import register_jitable

from imu_recording.compilation import COMPILATION_LISTENERS

F = TypeVar('F', bound=Callable[..., Any])

_KERNELS: list[Any] = []
_VERSIONS: dict[str, str] = {}
"""Module → digest of its version when its first kernel was defined."""


@overload
def njit(function: F) -> F: ...


@overload
def njit(function: None = None, **options: Any) -> Callable[[F], F]: ...


def njit(function: Any = None, **options: Any) -> Any:
    """Compile a module-level kernel and keep it on disk: `@njit` or `@njit(nogil=True)`."""
    if function is None:
        return partial(njit, **options)
    chosen = numba.config.CACHE_DIR  # NUMBA_CACHE_DIR, where the user set it
    folder = _cache_folder(function, options, chosen)
    numba.config.CACHE_DIR = folder
    try:
        options |= {'cache': bool(folder), 'no_cfunc_wrapper': True}
        kernel = numba.njit(**options)(function)
    finally:
        numba.config.CACHE_DIR = chosen
    if folder:
        _save_one_at_a_time(kernel._cache._cache_file, Path(folder) / 'saving.lock')
    _KERNELS.append(kernel)
    return kernel


def _save_one_at_a_time(cache: Any, lock: Path) -> None:
    """Let no two processes save a kernel for different types of arguments at once.

    numba takes the next free name for the code and then writes it into an index: two processes
    that do so together give the code of both the same name, and one runs that of the other.
    """
    save = cache.save

    def save_alone(key: Any, data: Any) -> None:
        with lock.open('a') as held:
            fcntl.flock(held, fcntl.LOCK_EX)
            save(key, data)

    cache.save = save_alone


def inline(**options: Any) -> Callable[[F], F]:
    """Let kernels call a function: compiled into them, plain Python to everybody else.

    It has no compiled entry of its own, which takes most of the time to compile a small kernel.
    """

    def decorate(function: F) -> F:
        _version(function)
        made: F = register_jitable(no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)(
            function
        )
        return made

    return decorate


def entry_of(kernel: Any, arguments: tuple[Any, ...]) -> Callable[..., Any]:
    """Return the compiled code of a kernel for arguments of these types, and of no others.

    A kernel looks up the types of its arguments at every call, which for tuples and typed lists
    takes longer than many a kernel runs. Call the kernel with such arguments once before.
    """
    entry: Callable[..., Any] = kernel.overloads[
        tuple(map(kernel.typeof_pyval, arguments))
    ].entry_point
    return entry


class _FirstCompilation(Listener):  # type: ignore[misc]
    """Calls `COMPILATION_LISTENERS` before this process first compiles a kernel."""

    def on_start(self, _: Any) -> None:
        """Call the listeners, once."""
        while COMPILATION_LISTENERS:
            COMPILATION_LISTENERS.pop()()

    def on_end(self, _: Any) -> None:
        """Do nothing: the start counts."""


register('numba:compile', _FirstCompilation())


def compiled_here() -> list[str]:
    """Return the kernels this process had to compile because no cache held them."""
    return [
        f'{kernel.py_func.__module__}.{kernel.py_func.__qualname__}'
        for kernel in _KERNELS
        if sum(kernel.stats.cache_misses.values())
    ]


def _cache_folder(function: Callable[..., Any], options: dict[str, Any], chosen: str) -> str:
    """Return the folder of this version of a kernel, '' where nothing can be written.

    Looked at are the folder the user chose, `__pycache__` beside the file, the user's cache.
    """
    version = hashlib.sha256(f'{_version(function)} {sorted(options.items())}'.encode())
    places = [chosen] if chosen else []
    places.append(str(Path(inspect.getfile(function)).with_name('__pycache__')))
    places.append(os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache'))  # noqa: PTH111
    for place in places:
        folder = Path(place) / f'kernels-{version.hexdigest()[:16]}'
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        return str(folder)
    return ''


def _version(function: Callable[..., Any]) -> str:
    """Return the digest of a kernel's file, of the files it imports kernels from and constants."""
    module = function.__module__
    if module not in _VERSIONS:
        parts = hashlib.sha256(Path(inspect.getfile(function)).read_bytes())
        for name, value in sorted(function.__globals__.items()):
            origin = getattr(value, '__module__', None) or getattr(value, '__name__', None)
            if isinstance(origin, str) and origin in _VERSIONS:
                parts.update(f'{name} of {_VERSIONS[origin]}'.encode())
            elif not name.startswith('__') and _is_constant(value):
                parts.update(f'{name} is {value!r}'.encode())
        _VERSIONS[module] = parts.hexdigest()
    return _VERSIONS[module]


def _is_constant(value: object) -> bool:
    """Whether kernels compile the value in: a number, a text, a tuple of these."""
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return isinstance(value, bool | int | float | complex | str)
