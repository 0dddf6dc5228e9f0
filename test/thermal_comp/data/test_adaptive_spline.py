# SPDX-License-Identifier: Apache-2.0
"""A spline is soft at a corner and stiff where the signal is straight."""

import numpy as np
import pytest
from thermal_comp.data.adaptive_spline import adaptive_spline


def test_a_corner_stays_sharp_and_less_noise_stays_beside_it() -> None:
    """Against the same spline where the corner is not: its stiffness is the straight line's."""
    at = np.arange(2000.0)
    line, corner = 0.01 * at, 0.02 * np.maximum(at - 1000.0, 0.0)
    beside = np.abs(at - 1000.0) > 300.0
    errors = []
    for seed in range(4):
        noise = 0.05 * np.random.default_rng(seed).standard_normal(len(at))
        found = adaptive_spline(corner + noise, 12.0)
        single = adaptive_spline(line + noise, 12.0)
        assert found is not None
        assert single is not None
        errors.append([
            np.std((found - corner)[beside]), np.abs(found - corner).max(), np.std(single - line),
        ])  # fmt: skip
    near, at_corner, straight = np.mean(errors, axis=0)
    assert near < 2.0 * straight
    assert at_corner < 0.08


@pytest.mark.parametrize('width', [1.0, 20.0, 60.0])
@pytest.mark.parametrize('slope', [0.0, 0.02])
def test_a_straight_line_without_noise_stays_one(slope: float, width: float) -> None:
    """All stiffness is as likely there: the search for the likeliest has to end."""
    line = slope * np.arange(500.0)
    np.testing.assert_allclose(adaptive_spline(line, width), line, atol=1e-4)


def test_a_first_reading_that_is_off_is_not_followed() -> None:
    """A filter that starts, or a conversion that was not complete: nothing settles after it."""
    line = 40.0 - 0.01 * np.arange(2000.0)
    readings = line + 0.02 * np.random.default_rng(3).standard_normal(len(line))
    straight = adaptive_spline(readings, 30.0)
    readings[0] -= 0.5
    found = adaptive_spline(readings, 30.0)
    assert found is not None
    assert straight is not None
    assert np.abs(found - straight).max() < 0.12


def test_few_rows_have_none() -> None:
    assert adaptive_spline(np.zeros(200), 60.0) is None
