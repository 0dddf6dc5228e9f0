# SPDX-License-Identifier: Apache-2.0
"""Effects in order: what was put in comes first, and nothing is likely where nothing was."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.diagnosis.findings import effect_sentence, ranked_effects

from .one_run import CATALOGUE, behind, lagging_gyroscope, searched


def test_what_was_put_in_comes_first_with_its_time_constant() -> None:
    answer = lagging_gyroscope()
    ranked = ranked_effects({'gyroscope': answer})
    assert [r.name for r in ranked] == ['thermal_lag', 'warm_up']
    assert ranked[0].effect.time_constant == pytest.approx(300.0, rel=0.1)
    assert ranked[0].probability > 0.9
    assert ranked[1].probability < 0.2
    assert ranked[0].log_odds > 10.0


def test_noise_alone_makes_no_effect_likelier_than_none() -> None:
    ranked = ranked_effects({'gyroscope': searched(np.zeros(len(behind(300.0))))})
    assert {r.name for r in ranked} == set(CATALOGUE)
    assert all(r.probability < 0.3 and r.log_odds < 0.0 for r in ranked)
    assert [r.probability for r in ranked] == sorted((r.probability for r in ranked), reverse=True)


def test_sensors_keep_to_themselves() -> None:
    answer = lagging_gyroscope()
    both = ranked_effects({'gyroscope': answer, 'accelerometer': answer})
    assert [r.sensor for r in both] == ['gyroscope'] * 2 + ['accelerometer'] * 2
    assert [r.probability for r in both[:2]] == [r.probability for r in both[2:]]


@pytest.mark.parametrize(
    ('chance', 'said'), [(0.99, 'is'), (0.95, 'is'), (0.8, 'is probably'), (0.4, 'may be')]
)
def test_an_effect_is_said_as_surely_as_it_is_probable(chance: float, said: str) -> None:
    sentence = effect_sentence('thermal_lag', 'gyroscope', chance)
    assert sentence == f'gyroscope: thermal_lag {said} missing'
