# SPDX-License-Identifier: Apache-2.0
"""A user's mistake in one line."""

from __future__ import annotations


def error_line(error: Exception) -> str:
    r"""Return what went wrong, with the file's name where the system knows it.

    >>> error_line(ValueError('two\n  words'))
    'two words'
    """
    if isinstance(error, OSError) and error.strerror:
        text = f'{error.filename}: {error.strerror}' if error.filename else error.strerror
    else:
        text = str(error) or type(error).__name__
    return ' '.join(text.split())
