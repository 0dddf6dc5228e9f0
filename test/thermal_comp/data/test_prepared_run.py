# SPDX-License-Identifier: Apache-2.0
"""A run in blocks: their means, and the columns of effects averaged over them."""

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS

from .at_rest import still


def test_block_means_keep_the_mean_and_lose_the_noise() -> None:
    recording = still(1.0, 10.0)
    (run,) = prepare([recording], period=20.0)
    measured = run.measured['accelerometer']
    assert len(run) == 180
    np.testing.assert_allclose(
        measured.mean(axis=0), recording.linear_acceleration.mean(axis=0), rtol=1e-12
    )
    assert measured.std(axis=0) == pytest.approx(0.01 / np.sqrt(200), rel=0.25)


def test_columns_are_those_of_the_samples_averaged() -> None:
    recording = still(1.0, 0.5)
    (run,) = prepare([recording], period=20.0)
    column = run.columns(EFFECTS['bias_temperature'](), 'gyroscope')
    np.testing.assert_allclose(
        column[:, 0], (recording.temperature - 20.0).reshape(-1, 10).mean(axis=1), rtol=1e-12
    )
