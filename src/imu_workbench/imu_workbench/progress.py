# SPDX-License-Identifier: Apache-2.0
"""One line on the terminal that says what is being worked on; silent where nobody looks."""

from __future__ import annotations

import shutil
import sys


def show_progress(text: str) -> None:
    """Replace the progress line on standard error by `text`; '' clears it."""
    if not sys.stderr.isatty():
        return
    width = shutil.get_terminal_size().columns - 1
    sys.stderr.write(f'\r\x1b[K{text[:width]}')
    sys.stderr.flush()
