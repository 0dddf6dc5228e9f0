# SPDX-License-Identifier: Apache-2.0
"""Probabilities of explanations: they sum to one, and the set that is reported is the smallest."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.posterior import CREDIBLE, credible, probability
from thermal_comp.diagnosis.sensor_search import SensorAnswer, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.noise.of_runs import determined_noise

from ..campaign import chamber, lagging, run


@cache
def answer(lag: float, curvature: float) -> SensorAnswer:
    """Return what explains a gyroscope with a lag and a curvature of these sizes."""
    time, temperature, *_ = chamber()
    behind = temperature - lagging(temperature, 300.0, float(time[1] - time[0]))
    error = lag * behind + curvature * ((temperature - 20.0) / 30.0) ** 2
    shaped = error[:, None] * np.array([1.0, -0.5, 0.7])
    runs = prepare([
        run(up, seed=k, error={'angular_velocity': shaped}) for k, up in enumerate(('+x', '-z'))
    ])  # fmt: skip
    base = {'gyroscope': (BiasTemperature(),)}
    return search_sensors(runs, base, determined_noise(runs, base)[0], Settings(EFFECTS))[
        'gyroscope'
    ]


SIZES = [(0.0, 0.0), (2e-4, 0.0), (2e-4, 1e-3)]


@pytest.mark.parametrize('sizes', SIZES)
def test_probabilities_sum_to_one_and_the_credible_set_is_the_smallest(sizes) -> None:
    found = answer(*sizes).explanations
    assert sum(e.probability for e in found) == pytest.approx(1.0, abs=1e-9)
    assert all(e.probability >= f.probability for e, f in pairwise(found))
    kept = credible(found)
    assert sum(e.probability for e in kept) >= CREDIBLE
    assert sum(e.probability for e in kept[:-1]) < CREDIBLE


@pytest.mark.parametrize(
    ('sizes', 'names'),
    zip(
        SIZES,
        [(), ('thermal_lag',), ('bias_temperature_curvature', 'thermal_lag')],
        strict=True,
    ),
)
def test_what_was_put_in_is_the_likeliest_explanation(sizes, names) -> None:
    said = answer(*sizes)
    assert said.likeliest.names == names
    assert probability(said.explanations, lambda e: e.names == names) > 0.5
