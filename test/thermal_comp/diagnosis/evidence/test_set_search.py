# SPDX-License-Identifier: Apache-2.0
"""The search extends what is likeliest, and offers no effect twice."""

import numpy as np
from thermal_comp.diagnosis.evidence.set_search import (
    MOST_EFFECTS,
    additions_to,
    best_single,
    likeliest_sets,
)

from ...campaign import chamber
from ..one_run import CATALOGUE, PERIOD, behind, lagging_gyroscope, searched


def test_the_likeliest_set_has_what_was_put_in_and_nothing_else() -> None:
    hypotheses = lagging_gyroscope().hypotheses
    sets = likeliest_sets(hypotheses)
    assert sets[0].names == ('thermal_lag',)
    assert [s.log_posterior for s in sets] == sorted((s.log_posterior for s in sets), reverse=True)
    assert max(len(s.names) for s in sets) <= MOST_EFFECTS
    assert len({s.names for s in sets}) == len(sets)


def test_an_effect_of_a_set_is_not_offered_to_it_again() -> None:
    hypotheses = lagging_gyroscope().hypotheses
    nothing, lag = (
        next(s for s in likeliest_sets(hypotheses) if s.names == names)
        for names in ((), ('thermal_lag',))
    )
    assert set(CATALOGUE) <= set(additions_to(hypotheses, nothing))
    assert 'thermal_lag' not in additions_to(hypotheses, lag)


def test_the_best_form_of_one_family_is_a_set_of_its_own() -> None:
    hypotheses = lagging_gyroscope().hypotheses
    family = next(f for f in hypotheses.families if f.name == 'warm_up')
    assert best_single(hypotheses, family).names == ('warm_up',)


def test_what_louder_slow_noise_would_do_as_well_is_found() -> None:
    """Beside it no effect adds anything; without it the drift does, and then the lag."""
    time = chamber(1, PERIOD)[0]
    drift = 6e-4 * (time / time[-1] - 0.5)
    names = ('bias_drift', 'thermal_lag')
    alone = searched(drift, names)
    quietest = alone.hypotheses.nuisances[0][1]
    assert len(alone.hypotheses.likeliest_nuisances(())) > len(quietest)
    assert alone.probability_of('bias_drift') > 0.8
    both = searched(drift + 1e-5 * behind(700.0), names)
    assert both.likeliest.names == names
    assert np.ptp([both.probability_of(name) for name in names]) < 0.1
