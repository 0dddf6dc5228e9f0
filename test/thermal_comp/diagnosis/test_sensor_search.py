# SPDX-License-Identifier: Apache-2.0
"""Noise that is louder than a sensor usually has may be a cause without a name."""

from dataclasses import replace

import pytest
from thermal_comp.diagnosis.sensor_search import with_cause_of_noise

from .one_run import lagging_gyroscope


def test_noise_that_is_far_too_loud_has_a_cause_beside_a_named_effect() -> None:
    answer = lagging_gyroscope()
    noise = answer.hypotheses.design.noise
    quiet = replace(noise, white=noise.white / 300.0, amplitudes=noise.amplitudes / 300.0)
    alike, loud = (with_cause_of_noise(replace(answer, usual_noise=n)) for n in (noise, quiet))
    assert alike.explanations == answer.explanations
    assert loud.probability_of('thermal_lag') < 0.2 < answer.probability_of('thermal_lag')
    assert sum(e.probability for e in loud.explanations) == pytest.approx(1.0, abs=1e-9)
    kept = [
        {
            e.names: e.probability
            for e in a.explanations
            if {'thermal_lag', 'unlogged'} <= {*e.names}
        }
        for a in (answer, loud)
    ]
    assert kept[0]
    assert kept[1] == pytest.approx(kept[0])
