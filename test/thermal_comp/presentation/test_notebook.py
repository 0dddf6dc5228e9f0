# SPDX-License-Identifier: Apache-2.0
"""Results in a notebook: tables are escaped, and only a missing matplotlib is told as one."""

from __future__ import annotations

from html.parser import HTMLParser

import pytest
from imu_recording.user_error import UserError
from thermal_comp.presentation.notebook import html_table

from ..models import line_model


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


def test_a_result_prints_and_shows_itself() -> None:
    model = line_model()
    assert repr(model).startswith('thermal model of dut1')
    assert model._repr_html_().startswith('<b>thermal model of dut1')


@pytest.mark.parametrize(
    ('missing', 'error', 'message'),
    [
        ('matplotlib.figure', UserError, r'plot\(\) needs matplotlib: pip install matplotlib'),
        ('scipy', ModuleNotFoundError, 'No module named .scipy.'),
    ],
)
def test_a_missing_library_is_told_as_what_it_is(
    missing: str, error: type[Exception], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def picture(model: object) -> None:
        raise ModuleNotFoundError(f'No module named {missing!r}', name=missing)

    monkeypatch.setattr('thermal_comp.presentation.model.picture', picture)
    with pytest.raises(error, match=message):
        line_model().plot()
