# SPDX-License-Identifier: Apache-2.0
"""What a diagnosis believes beforehand are probabilities, and larger flaws are less likely."""

import numpy as np
import pytest
from thermal_comp.diagnosis.evidence.priors import (
    AMPLITUDES,
    LOOKS_LIKE_LOST_PROBABILITY,
    SLOW_NOISE_RATIOS,
    THERMOMETER_LAGS_S,
    TWIN_SHARE,
    amplitude_log_prior,
    flaw_log_prior,
    log_odds_of_twin,
    probability_of_lost,
)


@pytest.mark.parametrize('alternatives', [SLOW_NOISE_RATIOS, THERMOMETER_LAGS_S])
def test_alternatives_share_one(alternatives: tuple[tuple[float, ...], ...]) -> None:
    assert sum(probability for *_, probability in alternatives) == pytest.approx(1.0)


@pytest.mark.parametrize('explained', [0.0, 10.0, 300.0, 1e5])
def test_a_flaw_has_some_size(explained: float) -> None:
    assert np.exp(flaw_log_prior(explained)).sum() == pytest.approx(1.0)


def test_an_effect_beside_another_is_likeliest_as_large_as_that() -> None:
    alone = np.exp(amplitude_log_prior(None))
    assert alone == pytest.approx(np.full(len(AMPLITUDES), 1.0 / len(AMPLITUDES)))
    beside = amplitude_log_prior(AMPLITUDES[6])
    assert int(np.argmax(beside)) == 6
    assert np.exp(beside).sum() <= 1.0 + 1e-6


def test_equations_lack_more_where_they_explain_more() -> None:
    likeliest = [int(np.argmax(flaw_log_prior(e))) for e in (100.0, 3000.0, 60000.0)]
    assert likeliest == sorted(set(likeliest))


def test_what_a_twin_explains_better_speaks_against_the_other_beyond_some_per_cent() -> None:
    odds = [log_odds_of_twin(share) for share in (0.0, 0.01, TWIN_SHARE, 0.2, 1.0)]
    assert odds == sorted(odds, reverse=True)
    assert odds[0] == pytest.approx(0.0, abs=1e-6)
    assert odds[2] == pytest.approx(np.log(0.5))


def test_what_is_much_larger_than_traces_of_a_lost_channel_is_no_part_of_what_that_does() -> None:
    found = [probability_of_lost(ratio) for ratio in (1.0, 4.0, 30.0, 1e6)]
    assert found == sorted(found, reverse=True)
    assert found[0] > LOOKS_LIKE_LOST_PROBABILITY > 0.5 > found[2]
    assert probability_of_lost(0.25) == pytest.approx(found[1])
    assert probability_of_lost(0.0) == pytest.approx(0.0)
