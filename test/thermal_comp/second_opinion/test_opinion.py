# SPDX-License-Identifier: Apache-2.0
"""The second opinion against what a board of the test's own then does when it cools."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.recording import FloatArray
from thermal_comp.model.values import ModelError
from thermal_comp.second_opinion.opinion import SecondOpinion, second_opinion

from .warm_ups import RAMP_S, RATE_HZ, warmed


def left_when_cooling(opinion: SecondOpinion, error: FloatArray) -> float:
    half = len(error) // 2
    temperature = 40.0 * (1.0 - np.abs(np.arange(len(error)) / RATE_HZ / RAMP_S - 1.0))
    left = error - opinion.sensors['accelerometer'].cubic.error(temperature)
    return float(np.sqrt(np.mean((left[half:] - left[:half].mean(axis=0)) ** 2)))


@pytest.mark.parametrize('lag', [True, False])
def test_one_warm_up_cannot_tell_and_predicts_what_cooling_leaves(lag: bool) -> None:
    recording, _ = warmed(back=False, lag=lag)
    opinion = second_opinion(recording, 'px4')
    assert not opinion.decidable
    assert opinion.both_ways < 0.1
    low, _, high = opinion.sensors['accelerometer'].cooling
    _, error = warmed(back=True, lag=lag)
    # Where there is none, draws of a lag that the noise allows are all larger.
    assert (0.9 if lag else 0.7) * low <= left_when_cooling(opinion, error) <= 1.05 * high


def test_the_way_back_tells_a_lag() -> None:
    recording, _ = warmed(back=True, lag=True)
    opinion = second_opinion(recording, 'ardupilot')
    assert opinion.decidable
    part = opinion.sensors['accelerometer']
    assert part.held_out.max() > 10.0 * part.noise_floor.max()
    low, _, high = part.cooling
    assert high < 1.2 * low  # known, as the log has seen it
    assert opinion.sensors['gyroscope'].held_out.max() < 2.0 * (
        opinion.sensors['gyroscope'].noise_floor.max()
    )


def test_the_same_seed_gives_the_same_answer() -> None:
    recording, _ = warmed(back=False, lag=True)
    one, same = (second_opinion(recording, 'px4', seed=3) for _ in range(2))
    for sensor, part in one.sensors.items():
        np.testing.assert_array_equal(part.cooling, same.sensors[sensor].cooling)


def test_a_constant_temperature_has_no_curve() -> None:
    recording, _ = warmed(back=False, lag=True)
    steady = recording.rows(recording.temperature < 3.0)
    with pytest.raises(ModelError, match='no range for a curve'):
        second_opinion(steady, 'px4')
