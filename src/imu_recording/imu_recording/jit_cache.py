# SPDX-License-Identifier: Apache-2.0
"""When a kernel compiled earlier may be used again.

numba looks at the file a kernel stands in. A kernel also holds what it calls and the constants it
reads, compiled in, so its stamp here covers its file, the stamps of the files it imports kernels
from, the values of constants, and how it is compiled. Where numba lacks what this needs, its own
rule holds.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

try:
    from numba import config
    from numba.core.caching import (
        InTreeCacheLocator,
        UserProvidedCacheLocator,
        UserWideCacheLocator,
    )
except ImportError:
    config = None

_digests: dict[str, str] = {}
"""Of every module with kernels, as it was when its first kernel was defined."""
_stamps: dict[tuple[str, str], str] = {}
"""Of every kernel: module and name → stamp."""


def note(function: Callable[..., Any], options: dict[str, Any]) -> None:
    """Take down what the compiled function will depend on; call before it is compiled."""
    module = function.__module__
    if module not in _digests:
        _digests[module] = _digest(function)
    choices = sorted((name, repr(value)) for name, value in options.items())
    _stamps[module, function.__qualname__] = f'{_digests[module]} {choices}'


def _digest(function: Callable[..., Any]) -> str:
    """Return the digest of a kernel's file and of what that file has imported."""
    parts = hashlib.sha256(Path(inspect.getfile(function)).read_bytes())
    for name, value in sorted(function.__globals__.items()):
        origin = getattr(value, '__module__', None) or getattr(value, '__name__', None)
        if isinstance(origin, str) and origin in _digests:
            parts.update(f'{name} of {_digests[origin]}'.encode())
        elif not name.startswith('__') and _is_constant(value):
            parts.update(f'{name} is {value!r}'.encode())
    return parts.hexdigest()


def _is_constant(value: object) -> bool:
    """Whether kernels compile the value in: a number, a text, a tuple of these."""
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return isinstance(value, bool | int | float | complex | str)


@contextmanager
def locators() -> Iterator[None]:
    """Let numba ask here whether what it finds on disk is still good, unless the user chose."""
    chosen = getattr(config, 'CACHE_LOCATOR_CLASSES', None)
    if chosen != '':  # set by the user, or a numba that does not ask
        yield
        return
    config.CACHE_LOCATOR_CLASSES = ','.join(f'{__name__}.{c.__name__}' for c in LOCATORS)
    try:
        yield
    finally:
        config.CACHE_LOCATOR_CLASSES = chosen


if config is not None:

    class _Stamped:
        """Answers with a kernel's stamp."""

        def __init__(self, kernel: Any, file: str) -> None:
            super().__init__(kernel, file)  # type: ignore[call-arg]
            self._stamp = _stamps[kernel.__module__, kernel.__qualname__]

        def get_source_stamp(self) -> str:
            return self._stamp

    class InChosenFolder(_Stamped, UserProvidedCacheLocator):
        """In NUMBA_CACHE_DIR."""

    class BesideTheFile(_Stamped, InTreeCacheLocator):
        """In __pycache__."""

    class InUserCache(_Stamped, UserWideCacheLocator):
        """In the user's cache, for installations that cannot be written to."""

    LOCATORS: tuple[type, ...] = (InChosenFolder, BesideTheFile, InUserCache)
