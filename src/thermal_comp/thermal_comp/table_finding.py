# SPDX-License-Identifier: Apache-2.0
"""Something the numbers of a table say about themselves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class TableFinding:
    """What cannot be or asks for an explanation, and the explanations that compete."""

    name: str
    where: tuple[str, ...]
    text: str
    explanations: tuple[str, ...]

    def content(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'kind': 'data_quality',
            'name': self.name,
            'where': list(self.where),
            'text': self.text,
            'explanations': list(self.explanations),
        }
