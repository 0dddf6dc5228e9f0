# SPDX-License-Identifier: Apache-2.0
"""A bias that walks at random for days is noise; one that drifts is an effect."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects import EFFECTS

from imu_recording import ImuRecording

DAY_S = 86400.0
WHITE = 3e-4
"""Noise of a row [rad/s]."""


def three_days(seed: int, *, walk: float, drift: float) -> ImuRecording:
    """A gyroscope out of doors, a row a minute; steps of a walk and a drift in units of WHITE."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 3.0 * DAY_S, 60.0)
    swing = np.sin(2.0 * np.pi * time / DAY_S) + 0.4 * np.sin(2.0 * np.pi * time / 31e3)
    die = 22.0 + 5.0 * swing
    noise = rng.normal(size=(len(time), 3))
    noise += np.cumsum(rng.normal(0.0, walk, (len(time), 3)), axis=0)
    noise += np.outer(time / time[-1], [drift, -drift, drift])
    unknown = np.full_like(noise, np.nan)
    return ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64),
        temperature=die + 0.01 * rng.normal(size=len(time)),
        linear_acceleration=unknown,
        angular_velocity=np.outer(die - 20.0, [1e-4, -5e-5, 7e-5]) + WHITE * noise,
        magnetic_field=unknown,
        device='board',
        up_axis='+z',
    )


@pytest.mark.parametrize(
    ('seed', 'walk', 'drift', 'names'),
    [
        (2, 0.03, 0.0, ()),
        (3, 0.03, 0.0, ()),
        (4, 0.1, 0.0, ()),  # what is seen of it is a drift of five of the noise's σ
        (6, 0.1, 0.0, ()),
        (2, 0.0, 1.0, ('bias_drift',)),
    ],
)
def test_a_walk_is_no_drift(seed: int, walk: float, drift: float, names: tuple[str, ...]) -> None:
    recording = three_days(seed, walk=walk, drift=drift)
    found = diagnose([recording], catalogue={'bias_drift': EFFECTS['bias_drift']})
    (likeliest, *_) = found.explanations
    assert likeliest.names == names
    assert likeliest.probability > 0.7
