# SPDX-License-Identifier: Apache-2.0
"""A sensor whose counts are four times its noise lacks no effect: rounding is allowed for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose

from ..campaign import WHITE, run


@pytest.mark.parametrize('seed', [3, 5])
def test_rounding_to_counts_of_four_times_the_noise_is_no_effect(seed: int) -> None:
    still = run(cycles=2, seed=seed, period=1.0)
    count = 4.0 * WHITE['angular_velocity']
    rounded = count * np.round(still.angular_velocity / count)
    diagnosis = diagnose([replace(still, angular_velocity=rounded)])
    likeliest = {e.sensor: e for e in reversed(diagnosis.explanations)}['gyroscope']
    assert likeliest.names == ()
    assert likeliest.probability > 0.5
