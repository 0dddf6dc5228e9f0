# SPDX-License-Identifier: Apache-2.0
"""Where the memory of large arrays comes from."""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _MMAP_MAX = -1, -4
"""Parameters of glibc's mallopt."""


def keep_memory() -> bool:
    """Keep freed memory for the next array instead of returning it; tell whether that worked.

    glibc gives every large array back to the kernel and gets the next one page by page, zeroed:
    a fifth of the time of work over many columns. For processes that end with their work; where
    the C library has no such switch nothing changes.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return False
    return bool(mallopt(_MMAP_MAX, 0)) and bool(mallopt(_TRIM_THRESHOLD, 2**31 - 1))
