# SPDX-License-Identifier: Apache-2.0
"""The second opinion against what a board of the test's own then does when it cools."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from thermal_comp.comparison.second_opinion import SecondOpinion, second_opinion
from thermal_comp.model.values import ModelError

RATE_HZ = 5.0
RAMP_S = 2400.0
SLOPE = np.array([3e-3, -2e-3, 4e-3])
LAG_S = 150.0
NOISE = 2e-3


def warmed(*, back: bool, lag: bool, seed: int = 1) -> tuple[ImuRecording, FloatArray]:
    """A warm-up from 0 to 40 °C, with or without the way back, and its error without noise.

    The accelerometer's elements follow the thermometer with a lag, step by step, or a curve of
    temperature stands in its place.
    """
    time = np.arange(0.0, RAMP_S * (2.0 if back else 1.0), 1.0 / RATE_HZ)
    temperature = 40.0 * (1.0 - np.abs(time / RAMP_S - 1.0))
    element, followed = temperature[0], np.empty_like(temperature)
    for k, value in enumerate(temperature):
        element += (value - element) * (1.0 - np.exp(-1.0 / (RATE_HZ * LAG_S)))
        followed[k] = element
    error = np.outer(followed if lag else temperature + 0.01 * temperature**2, SLOPE)
    rng = np.random.default_rng(seed)
    force = np.array([0.0, 0.0, 9.80665]) + error + rng.normal(0.0, NOISE, error.shape)
    turn = rng.normal(0.0, 1e-4, error.shape) + np.outer(temperature, SLOPE) * 1e-2
    recording = ImuRecording(
        stamp=(1e9 * time).astype(np.int64),
        angular_velocity=turn,
        linear_acceleration=force,
        magnetic_field=np.full_like(force, np.nan),
        temperature=temperature + rng.normal(0.0, 0.02, len(time)),
        device='board',
        up_axis='+z',
    )
    return recording, error


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
