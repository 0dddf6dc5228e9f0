# SPDX-License-Identifier: Apache-2.0
"""Verdicts on temperature follow from the numbers, on cases whose answer is known."""

import numpy as np
import pytest
from imu_workbench.report.claims.thermal import (
    device_claim,
    orientation_claim,
    overheating_claim,
    pooled_claim,
    range_claim,
)


@pytest.mark.parametrize(
    ('ours', 'verdict'), [((0.3, 5.0, 100.0), 'supported'), ((0.3, 0.9, 100.0), 'not')]
)
def test_ranges_are_compared_without_start_up(ours, verdict) -> None:
    published = (0.31, 5.92, 132.01)
    ranges = {
        sensor: {'unit': 'u', 'paper': p, 'without_start_up': o, 'with_start_up': 6.0}
        for sensor, p, o in zip('gam', published, ours, strict=True)
    }
    assert range_claim(ranges).verdict == verdict
    assert range_claim({}).verdict == 'untestable'


def slopes(mean, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(mean, 0.01, (4, 3))


def test_orientation_and_devices() -> None:
    alike = {'x': slopes(1.0, 1), 'y': slopes(1.0, 2), 'z': slopes(1.0, 3)}
    bent = {'x': slopes(1.0, 1), 'y': slopes(1.3, 2), 'z': slopes(1.0, 3)}
    assert orientation_claim({'a': {'gyroscope': alike}}).verdict == 'supported'
    assert orientation_claim({'a': {'gyroscope': bent}}).verdict == 'not'
    assert orientation_claim({'a': {'gyroscope': {'x': slopes(1, 1)}}}).verdict == 'untestable'
    two = {'a': {'gyroscope': {'x': slopes(1.0, 1)}}, 'b': {'gyroscope': {'x': slopes(-1.0, 2)}}}
    found = device_claim(two)
    assert found.verdict == 'supported'
    assert '3 pairs have opposite signs' in found.ours
    assert device_claim({'a': two['a']}).verdict == 'untestable'


def test_pooling_and_overheating() -> None:
    test = {'own_rms': [[1.0] * 3] * 2, 'pooled_rms': [[5.0] * 3] * 2}
    assert pooled_claim({'g': test | {'opposite_signs': [True] * 3}}).verdict == 'supported'
    assert pooled_claim({'g': test | {'opposite_signs': [False] * 3}}).verdict == 'not'
    assert pooled_claim({}).verdict == 'untestable'
    assert overheating_claim({}).verdict == 'untestable'
    warm = overheating_claim({'r': {'die': {'mean_k': 1.5, 'std_k': 0.1}}})
    assert '1.5' in warm.ours
