# SPDX-License-Identifier: Apache-2.0
"""A die's thermometer that copies another sensor's, or has a scale of its own, in a stream."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from thermal_comp.data.thermometer_comparison import ThermometerComparison

SECOND = 1_000_000_000
SEEDS = range(8)


def watched(seed: int, fault: str) -> ThermometerComparison:
    """One hour: a robot's surroundings change by 15 K, its die follows 8 K warmer, lagging.

    The surroundings are measured every second in steps of 0.01 K, the die five times a second
    in steps of 1/16 K. Messages of the first may come after those of the second that were
    measured later.
    """
    rng = np.random.default_rng((seed, 15))
    comparison = ThermometerComparison()
    lag, span, swing = rng.uniform(100.0, 900.0), rng.uniform(12.0, 20.0), rng.uniform(2e3, 4e3)
    base = rng.uniform(0.0, 30.0)
    scale = {'scale': rng.choice([1.8, 0.1])}.get(fault, 1.0)
    seconds = np.arange(3600)
    truth = base + 0.5 * span * (1.0 - np.cos(2 * np.pi * seconds / swing))
    air = np.round(truth + rng.normal(0.0, 0.02, 3600), 2)
    followed, _ = lfilter(
        [1.0 / lag], [1.0, 1.0 / lag - 1.0], truth, zi=[base * (1.0 - 1.0 / lag)]
    )
    read = followed[:, None] * scale + 8.0 + rng.normal(0.0, 0.05, (3600, 5))
    shown = np.round(read * 16.0) / 16.0
    if fault == 'copy':
        shown[:] = air[:, None]
    late = rng.random(3600) < 0.5
    for second in range(3600):
        for k, value in enumerate(shown[second].tolist()):
            if k == 2 * late[second]:
                comparison.on_other('device_temperature', second * SECOND, float(air[second]))
            comparison.on_die(second * SECOND + k * SECOND // 5, value)
    return comparison


@pytest.mark.parametrize(
    ('fault', 'said'), [('', ''), ('copy', 'a copy of device_temperature'), ('scale', 'scale')]
)
def test_each_fault_is_found_and_none_in_a_sound_stream(fault: str, said: str) -> None:
    told = [watched(seed, fault).fault for seed in SEEDS]
    right = [said in text if said else not text for text in told]
    assert np.mean(right) == 1.0, told


def test_a_stream_without_other_thermometers_says_nothing() -> None:
    comparison = ThermometerComparison()
    for second in range(1000):
        comparison.on_die(second * SECOND, 20.0 + second / 16)
    assert comparison.fault == ''
