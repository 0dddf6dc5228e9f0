# SPDX-License-Identifier: Apache-2.0
"""Technical words of the page explain themselves."""

import re

from imu_workbench.web.words import ENTRY_OF_WORD, PAGE_WORDS, with_help, word
from thermal_comp.presentation.words import VERDICT_SENTENCES


def test_every_word_has_one_meaning() -> None:
    assert all((key in PAGE_WORDS) != (key in VERDICT_SENTENCES) for key in ENTRY_OF_WORD.values())
    assert 'role="tooltip">How much an explanation is believed' in word('97 %', 'probability')


def test_a_title_keeps_its_words_and_explains_the_technical_ones() -> None:
    title = 'Where it fails: residual in units of the noise floor'
    html = with_help(title)
    assert html.count('role="tooltip"') == 2  # "noise floor" is one word
    without = re.sub('<span class="meaning".*?</span>', '', html)
    assert re.sub('<.*?>', '', without) == title
