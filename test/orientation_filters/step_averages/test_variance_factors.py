# SPDX-License-Identifier: Apache-2.0
"""The factor of innovations is that of the error, whatever noise is wrong; what persists shows."""

from __future__ import annotations

import numpy as np
import pytest
from orientation_filters.step_averages.variance_factors import (
    FIELD_TIME_S,
    no_error,
    no_factors,
    observe_angle,
    observe_error,
    scaled,
    started_anew,
)

STEP = 0.1
NONE = (0.0, 0.0)


@pytest.mark.parametrize(('walk', 'noise'), [(1.0, 1.0), (0.1, 0.1), (0.0, 0.2), (9.0, 1.0)])
def test_the_factor_is_that_of_the_error(walk: float, noise: float) -> None:
    """A filter of one angle that assumes densities 1 e-6 and 4 e-6, the true ones times these."""
    rng = np.random.default_rng(3)
    q, r = 1e-6, 4e-6
    known = no_factors().heading
    variance, error = 1e-2, 0.05
    ratios = []
    for k in range(20_000):
        variance += q * STEP
        error += np.sqrt(walk * q * STEP) * rng.normal()
        seen = error + np.sqrt(noise * r / STEP) * rng.normal()
        known = observe_angle(known, (seen, 0.0), NONE, variance, r / STEP, STEP, 0.0, False)
        gain = variance / (variance + r / STEP)
        error, variance = error - gain * seen, (1.0 - gain) * variance
        if k > 1000:
            ratios.append((error**2 / variance, known.motion.factor))
    true, found = np.mean(ratios, axis=0)
    assert found == pytest.approx(true, rel=0.2)
    assert true == pytest.approx(0.5 * (walk + noise), rel=0.25)


def test_rest_and_motion_have_factors_of_their_own() -> None:
    known = no_factors().inclination
    for k in range(2000):
        rests = k % 400 < 200
        size = 0.1 if rests else 10.0
        angle = size * (-1.0) ** (k // 40) * 1e-3
        known = observe_angle(known, (angle, 0.0), NONE, 1e-6, 1e-5, STEP, 0.0, rests)
    assert known.motion.factor > 20.0 * known.rest.factor


def test_an_angle_that_is_found_wrong_tells_nothing_of_the_noise() -> None:
    """Wrong by thirty times its error for two seconds, at the start and once more."""
    rng = np.random.default_rng(5)
    variance, noise = 1e-6, 9e-6
    known = no_factors().heading
    for k in range(800):
        if k == 400:
            known = started_anew(known)
        wrong = 0.1 if k % 400 < 20 else 0.0
        seen = wrong + np.sqrt(variance + noise) * rng.normal()
        known = observe_angle(known, (seen, 0.0), NONE, variance, noise, STEP, 0.0, False)
    assert 0.4 < known.motion.factor < 2.0


def test_only_what_persists_widens_the_covariance() -> None:
    rng = np.random.default_rng(4)
    white, steady = no_error(), no_error()
    for _ in range(3000):
        noise = 0.02 * rng.normal(size=2)
        white = observe_error(white, (noise[0], noise[1]), STEP, FIELD_TIME_S)
        steady = observe_error(steady, (noise[0] + 0.03, noise[1]), STEP, FIELD_TIME_S)
    one = (1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4)
    nothing = no_factors()
    assert scaled(one, nothing) == one
    assert scaled(one, nothing._replace(field=white))[5] < 1.5e-4
    assert scaled(one, nothing._replace(field=steady))[5] == pytest.approx(1e-3, rel=0.15)
