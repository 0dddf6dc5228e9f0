# SPDX-License-Identifier: Apache-2.0
"""The paper's argument: slopes of devices differ, even in sign, and cannot be pooled."""

import numpy as np
import pytest
from thermal_comp.fitting.pooling import examine_pooling
from thermal_comp.model.values import ModelError

from ..campaign import SLOPES, run


def test_opposite_slopes_forbid_pooling_and_the_text_says_so() -> None:
    recordings = [run(device='a', cycles=2), run(device='b', cycles=2, seed=1, slope_factor=-0.5)]
    model, tests = examine_pooling(recordings)
    assert model.pooled
    gyroscope = tests['gyroscope']
    assert gyroscope.opposite_signs == [True, True, True]
    assert not gyroscope.poolable
    np.testing.assert_allclose(
        gyroscope.slopes,
        [SLOPES['angular_velocity'], -0.5 * SLOPES['angular_velocity']],
        rtol=0.05,
    )
    # Midway between the two, whatever the noise says.
    np.testing.assert_allclose(gyroscope.pooled_slope, 0.25 * SLOPES['angular_velocity'], rtol=0.2)
    assert (gyroscope.pooled_rms > 5.0 * gyroscope.own_rms).all()
    assert 'slopes have opposite signs' in gyroscope.lines()[0]
    assert 'rad/s/K' in gyroscope.lines()[0]


def test_equal_devices_may_be_pooled() -> None:
    recordings = [run(device=name, seed=k) for k, name in enumerate('ab')]
    _, tests = examine_pooling(recordings)
    # Nine axes at two standard deviations: at most one may differ by chance.
    differing = sum(int((test.normalised_difference > 1.0).sum()) for test in tests.values())
    assert differing <= 1
    assert not any(any(test.opposite_signs) for test in tests.values())


def test_one_device_cannot_be_pooled() -> None:
    with pytest.raises(ModelError, match="all recordings are of 'board'"):
        examine_pooling([run(cycles=1), run('+x', cycles=1, seed=1)])
