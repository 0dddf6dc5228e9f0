# SPDX-License-Identifier: Apache-2.0
"""Candidates are ranked by their probability, and say why they are not the one."""

from __future__ import annotations

from typing import Any

from imu_workbench.web.case.candidates import EffectCandidate, odds_text, why_not
from imu_workbench.web.case.rail import little_text


def candidates(found: dict[str, Any], sensor: str) -> list[EffectCandidate]:
    return [EffectCandidate(**row) for row in found['candidates'][sensor]]


def test_candidates_are_ranked_and_say_why_not(fitted, found):
    own = candidates(found, 'accelerometer')
    probabilities = [c.probability for c in own]
    assert probabilities == sorted(probabilities, reverse=True)
    assert own[0].effect == 'thermal_lag'
    assert own[0].named
    before = fitted.line.error('accelerometer')
    assert own[0].error_after == found['diagnosis']['findings'][0]['error_after']
    gradient = next(c for c in own if c.effect == 'thermal_gradient')
    assert why_not(own[0], own[0], before) == ''
    assert 'thermal lag 0.000685' in why_not(gradient, own[0], before)
    assert 'more than a million times less probable' in why_not(gradient, own[0], before)
    assert gradient.error_after > 1.5 * own[0].error_after
    nothing = [c for c in candidates(found, 'gyroscope') if c.error_after is not None]
    assert not any(c.lowers(fitted.line.error('gyroscope')) for c in nothing)
    assert 'Adds nothing' in little_text(nothing[0], fitted.line.error('gyroscope'))


def test_odds_are_said_as_people_say_them():
    pairs = (0.9, 9.3), (0.001, 0.0), (0.15, -50.0)
    one, unlikely, rival = (EffectCandidate('a', 'gyroscope', p, odds, None) for p, odds in pairs)
    assert odds_text(one, unlikely) == '10\N{NARROW NO-BREAK SPACE}000 times less probable'
    assert odds_text(one, rival) == '6 times less probable'  # as its 15 % beside 90 % say
    assert odds_text(rival, rival) == ''
