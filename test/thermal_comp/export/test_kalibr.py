# SPDX-License-Identifier: Apache-2.0
"""The noise file of Kalibr: the worst axis, and densities as simulated noise has them."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from thermal_comp.export.kalibr import densities, kalibr_text
from thermal_comp.model.values import NoiseModel

from .cubic_models import CUBIC, NOISE


def test_kalibr_file_holds_the_worst_axis() -> None:
    content = yaml.safe_load(kalibr_text(CUBIC, 200.0, '/imu0', 'test'))
    assert content['gyroscope_noise_density'] == pytest.approx(2e-3)
    assert content['gyroscope_random_walk'] == pytest.approx(1e-4 * math.sqrt(2.0 / 500.0))
    assert (content['rostopic'], content['update_rate']) == ('/imu0', 200)
    white, walk = densities(replace(NOISE, amplitudes=np.full((2, 3), 1e-4)))
    assert white[0] == pytest.approx(math.sqrt(1e-6 + 2.0 * 20.0 * 1e-8))
    assert walk[0] == pytest.approx(1e-4 * math.sqrt(2.0 / 500.0))


def test_kalibr_density_is_that_of_the_simulated_noise() -> None:
    """The random walk is the growth of the variance of a simulated process, early on."""
    tau, sigma, n = 1000.0, 0.3, 4000
    rng = np.random.default_rng(4)
    decay = math.exp(-1.0 / tau)
    start = rng.normal(0.0, sigma, n)
    x = start
    for _ in range(10):  # seconds
        x = decay * x + rng.normal(0.0, sigma * math.sqrt(1.0 - decay**2), n)
    grown = np.var(x - start) / 10.0
    noise = NoiseModel(np.zeros(3), np.array([tau]), np.full((1, 3), sigma))
    assert densities(noise)[1][0] ** 2 == pytest.approx(grown, rel=0.1)
