# SPDX-License-Identifier: Apache-2.0
"""An effect and an experiment in words: everything escaped, nothing empty."""

from __future__ import annotations

from html.parser import HTMLParser
from typing import Any

import pytest
from imu_workbench.web.case.explained import explanation_html, pairs_html, proposal_html

EFFECT: dict[str, Any] = {
    'summary': 'x < y',
    'equation': 'error = a & b',
    'mechanism': '<script>alert(1)</script>',
    'look_alikes': ['warm_up', 'thermal_lag'],
    'separation': '',
    'typical_size': '1 °/s',
    'sensors': ['gyroscope'],
    'channels': [],
    'substitutes': [],
    'reference': 'IEEE',
}
PROPOSAL: dict[str, Any] = {
    'effects': ['thermal_lag', 'warm_up'],
    'evidence_before': 0.5,
    'evidence_after': 40.0,
    'separable': True,
    'sensor': 'gyroscope',
    'repeats': 3,
    'hours': 7.25,
    'actions': ['wait an hour', 'go on'],
}


class Pairs(HTMLParser):
    """Reads names and values of a list, and the paragraphs, as a browser shows them."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tag, self.texts = '', {'dt': [], 'dd': [], 'p': []}
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        assert tag in {'dl', 'dt', 'dd', 'p'}
        self.tag = tag

    def handle_data(self, data: str) -> None:
        self.texts[self.tag].append(data)

    @property
    def pairs(self) -> list[tuple[str, str]]:
        return list(zip(self.texts['dt'], self.texts['dd'], strict=True))


def test_an_effect_is_shown_as_it_is_written() -> None:
    read = Pairs(explanation_html(EFFECT))
    assert read.texts['p'] == ['x < y', 'error = a & b']
    told = dict(read.pairs)
    assert told['mechanism'] == '<script>alert(1)</script>'
    assert told['looks like'] == 'warm up, thermal lag'
    assert told['needs'] == 'nothing beyond temperature and time'
    assert 'to tell it apart' not in told  # nothing is known


USUAL = 'M = 1, as large as the noise of a mean over a second'


@pytest.mark.parametrize(
    ('separable', 'verdict', 'missing'),
    [(True, 'separable', 1e-4), (False, 'not separable by temperature alone', None)],
)
def test_an_experiment_promises_what_it_tells(
    separable: bool, verdict: str, missing: float | None
) -> None:
    pairs = Pairs(proposal_html(PROPOSAL | {'separable': separable, 'missing': missing})).pairs
    told = dict(pairs)
    assert told['question'] == 'thermal lag or warm up in the gyroscope'
    assert told['answer'] == verdict
    assert told['length'] == '3 cycles, 7.2 h a run'
    assert told['evidence'].startswith('0.500 with the plan of Betta et al. 2022, 40.0')
    assert told['assumed size'] == ('what is missing now, 0.00573 °/s rms' if missing else USUAL)
    assert [text for name, text in pairs if name == 'do'] == ['wait an hour', 'go on']


def test_names_and_values_stand_in_pairs() -> None:
    assert Pairs(pairs_html([('a', '1 < 2'), ('b', '"')])).pairs == [('a', '1 < 2'), ('b', '"')]
