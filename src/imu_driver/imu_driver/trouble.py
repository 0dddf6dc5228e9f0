# SPDX-License-Identifier: Apache-2.0
"""What is to be read first among the things that happen."""

from __future__ import annotations


class Trouble(str):
    """An event that an operator should look at; other events are plain text."""

    __slots__ = ()
