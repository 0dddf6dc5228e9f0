# SPDX-License-Identifier: Apache-2.0
"""The most memory that a call holds at once."""

import os
import tracemalloc
from collections.abc import Callable


def peak_bytes(call: Callable[[], object]) -> int:
    """Return the peak [bytes], in a process of its own: other threads here allocate meanwhile."""
    call()  # imports, compiles
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            tracemalloc.start()
            call()
            os.write(writing, str(tracemalloc.get_traced_memory()[1]).encode())
            code = 0
        finally:
            os._exit(code)
    os.close(writing)
    _, failed = os.waitpid(child, 0)
    assert not failed, 'the call failed where its memory was measured'
    with os.fdopen(reading) as answer:
        return int(answer.read())
