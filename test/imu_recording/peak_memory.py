# SPDX-License-Identifier: Apache-2.0
"""The most memory that a call holds at once."""

import tracemalloc
from collections.abc import Callable


def peak_bytes(call: Callable[[], object]) -> int:
    """Return the peak [bytes], the least of three calls: other threads allocate meanwhile, too."""
    call()  # imports, compiles
    return min(_peak(call) for _ in range(3))


def _peak(call: Callable[[], object]) -> int:
    tracemalloc.start()
    try:
        call()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
