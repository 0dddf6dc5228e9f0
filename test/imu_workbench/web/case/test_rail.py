# SPDX-License-Identifier: Apache-2.0
"""The rail of candidates: explanations that act together, errors with their units."""

from __future__ import annotations

import re
from typing import Any

from imu_workbench.web.case.candidates import EffectCandidate
from imu_workbench.web.case.rail import errors_html, probability_text, together_html


def explanation(probability: float, *names: str, sensor: str = 'gyroscope') -> dict[str, Any]:
    return {
        'names': list(names), 'sensor': sensor, 'probability': probability, 'approximate': False,
        'depends_on': None,
    }  # fmt: skip


def rows_of(html: str) -> list[tuple[str, str]]:
    """Explanation and its probability, row by row."""
    return re.findall(r'<li>(.*?)<span class="number">(.*?)</span></li>', html)


def test_effects_that_act_together_stand_in_one_row_and_the_rows_are_all_there_is() -> None:
    lag, rate = 'thermal_lag', 'temperature_rate'
    told = [
        explanation(0.93, lag, 'warm_up'),
        explanation(0.04, rate, 'warm_up'),
        explanation(0.99, 'humidity', sensor='accelerometer'),
    ]
    assert rows_of(together_html(told, 'gyroscope')) == [
        ('thermal lag + warm up', '93 %'),
        ('temperature rate + warm up', '4 %'),
        ('anything else', '3 %'),
    ]


def test_single_effects_compete_and_need_no_word() -> None:
    told = [explanation(0.8, 'thermal_lag'), explanation(0.2, 'nothing')]
    assert together_html(told, 'gyroscope') == ''
    assert together_html(told, 'magnetometer') == ''
    hardly = [explanation(0.97, 'thermal_lag'), explanation(0.02, 'thermal_lag', 'warm_up')]
    assert together_html(hardly, 'gyroscope') == ''


def test_a_candidate_shows_its_errors_with_their_unit(fitted, found):
    html = errors_html(EffectCandidate(**found['candidates']['accelerometer'][0]), fitted.line)
    assert '0.00574 → <b>0.000685</b> m/s² (0.99 ×)' in html
    assert 'floor 0.000693' in html
    assert (probability_text(1e-6), probability_text(0.6), probability_text(None)) == (
        '< 1 %', '60 %', '',
    )  # fmt: skip
