# SPDX-License-Identifier: Apache-2.0
"""The χ² test keeps its level on correlated samples and sees two modes."""

import numpy as np
from imu_recording.recording import PHASES
from scipy.signal import lfilter
from thermal_comp.comparison.gaussianity import correlation_length, dwell_modes, gaussianity


def correlated(n: int, keep: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(n)
    return lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], noise)


def test_false_alarms_stay_at_five_percent_in_spite_of_correlation() -> None:
    found = [gaussianity([correlated(4000, 0.8, seed)]) for seed in range(200)]
    assert sum(not test.gaussian for test in found) <= 20
    assert {test.degrees for test in found} == {27}


def test_thinning_follows_the_correlation() -> None:
    # 1 + 2 Σ keep^k = (1 + keep) / (1 − keep) = 9.
    lengths = [correlation_length([correlated(20_000, 0.8, seed)]) for seed in range(5)]
    assert 8 <= np.mean(lengths) <= 10
    test = gaussianity([correlated(20_000, 0.8, 0)])
    assert test.effective_n == np.ceil((20_000 - test.thinning // 2) / test.thinning)


def test_two_modes_are_no_gaussian_and_belong_to_the_dwells() -> None:
    rng = np.random.default_rng(1)
    phase = np.repeat([PHASES.index('dwell_cold'), PHASES.index('dwell_hot')], 500)
    centre = np.where(phase == PHASES.index('dwell_hot'), 3.0, -3.0)
    values = centre[:, None] + rng.standard_normal((1000, 3))
    shuffled = rng.permutation(values[:, 0])
    assert gaussianity([shuffled]).gaussian is False
    modes = dwell_modes(values, phase)
    np.testing.assert_allclose(modes.hot, 3.0, atol=0.2)
    np.testing.assert_allclose(modes.separation, 6.0, rtol=0.1)
    assert modes.bimodal == [True] * 3
    assert dwell_modes(values, np.zeros(1000, dtype=np.int64)) is None


def test_too_few_samples_are_not_judged() -> None:
    assert gaussianity([np.random.default_rng(0).standard_normal(30)]).gaussian is None
    assert gaussianity([np.zeros(300)]).gaussian is None
