# SPDX-License-Identifier: Apache-2.0
"""One sensor's stretches pooled: its slope, its power-on spread, and a level that is odd."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.still.log import resting_log
from thermal_comp.still.pool import Pool

from imu_recording import ImuRecording

LOGS, RATE, G = 48, 10.0, 9.80665
SLOPE = np.array([2e-4, -1e-4, 0.0])
"""Of the gyroscope [rad/s/K]."""
TURN_ON = 1e-3
"""Standard deviation of its level from power-on to power-on [rad/s]."""


@cache
def stretch(number: int, odd: float = 0.0) -> PreparedRun:
    """A minute and a half at rest, a kelvin warmer than the log before."""
    rng = np.random.default_rng([number, 9])
    n = round(RATE * 90.0)
    temperature = float(number) + np.linspace(0.0, 0.5, n)
    level = TURN_ON * rng.standard_normal(3) + odd
    noise = rng.standard_normal((2, n, 3))
    recording = ImuRecording(
        stamp=np.round(np.arange(n) * (1e9 / RATE)).astype(np.int64),
        linear_acceleration=np.array([0.0, 0.0, G]) + 2e-3 * noise[0],
        angular_velocity=level + SLOPE * temperature[:, None] + 1e-3 * noise[1],
        magnetic_field=np.full((n, 3), np.nan),
        temperature=temperature,
        run=f'log{number}',
    )
    (run,) = resting_log(recording)[0].runs
    return run


@cache
def pool(odd: float = 0.0) -> Pool:
    """All stretches; the level of the sixth is off by `odd`."""
    runs = [stretch(number, odd * (number == 5)) for number in range(LOGS)]
    return Pool(runs, np.arange(len(runs)), np.full(len(runs), np.nan), 'gyroscope', (0.0, LOGS))


@pytest.mark.long
def test_the_slope_comes_back_within_its_uncertainty() -> None:
    model = pool().model()
    std = np.sqrt(np.diag(model.covariance))[:3]
    assert (std < 5e-5).all()
    assert (np.abs(model.coefficients[0][0] - SLOPE) < 3.5 * std).all()
    assert set(model.levels) == {f'log{number}#1' for number in range(LOGS)}


def test_the_spread_of_levels_is_told_and_ageing_is_not_asked_without_dates() -> None:
    curve = pool().sensor_curve()
    spread = np.hypot(curve.turn_on, curve.pose)
    assert (spread > 0.5 * TURN_ON).all()
    assert (spread < 2.0 * TURN_ON).all()
    assert np.isnan(curve.ageing).all()
    assert curve.held_out[0] < curve.raw[0]
    assert curve.log_levels.shape == (LOGS, 3)


@pytest.mark.long
def test_a_stretch_unlike_the_others_is_left_out_by_name() -> None:
    assert pool().odd == []
    found = pool(0.05)
    assert found.odd == ['log5#1']
    assert 'log5#1' not in found.model().levels
    apart = found.model().coefficients[0] - pool().model().coefficients[0]
    assert np.abs(apart).max() < 1e-5
