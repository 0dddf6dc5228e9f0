# SPDX-License-Identifier: Apache-2.0
"""A table as HTML, as a notebook shows it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def html_table(
    title: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    notes: Iterable[str] = (),
) -> str:
    """Return a table as HTML; every string is escaped."""
    return ''.join(
        [
            f'<b>{escape(title)}</b><table><thead><tr>',
            *(f'<th>{escape(name)}</th>' for name in head),
            '</tr></thead><tbody>',
            *(
                '<tr>' + ''.join(f'<td>{escape(cell)}</td>' for cell in row) + '</tr>'
                for row in rows
            ),
            '</tbody></table>',
            *(f'<div>{escape(note)}</div>' for note in notes),
        ]
    )
