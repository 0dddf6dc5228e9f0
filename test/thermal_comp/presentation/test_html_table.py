# SPDX-License-Identifier: Apache-2.0
"""A table as HTML: its texts are escaped."""

from __future__ import annotations

from html.parser import HTMLParser

from thermal_comp.presentation.html_table import html_table


class Cells(HTMLParser):
    """Collects the text between tags."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_a_browser_reads_back_what_was_written() -> None:
    cells = ['a < b', '"µ" & co', '<script>', "it's"]
    html = html_table('x & y', ['<head>'], [cells[:2], cells[2:]], ['note <1>'])
    parser = Cells()
    parser.feed(html)
    assert parser.texts == ['x & y', '<head>', *cells, 'note <1>']
