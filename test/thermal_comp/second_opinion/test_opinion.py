# SPDX-License-Identifier: Apache-2.0
"""The second opinion against what a board of the test's own then does, when it cools or anew."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from imu_recording.recording import FloatArray
from thermal_comp.export.cubic import Cubic
from thermal_comp.model.values import ModelError
from thermal_comp.second_opinion.opinion import (
    SecondOpinion,
    SensorOpinion,
    on_other_logs,
    second_opinion,
)

from .warm_ups import RAMP_S, RATE_HZ, warmed

LINE_SLOPE = 2e-3
"""Of every axis [rad/s/K]."""


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


def of_line(low: float, high: float, level: float, fitted: float = LINE_SLOPE) -> SecondOpinion:
    """A log without noise from one temperature to another, and a line of slope `fitted`."""
    temperature = np.linspace(low, high, 61)
    measured = level + LINE_SLOPE * np.outer(temperature, np.ones(3))
    line = np.zeros((4, 3))
    line[1] = fitted
    error = np.full(3, 0.1)
    judged = SensorOpinion(Cubic(line, 0.0, low, high), error, error, error, error)
    run = SimpleNamespace(measured={'gyroscope': measured}, temperature=temperature)
    return SecondOpinion('quad', 'px4', (low, high), 0.0, {'gyroscope': judged}, run)


def test_the_right_curve_leaves_nothing_whatever_the_levels() -> None:
    found = on_other_logs([of_line(10.0, 40.0, 0.0), of_line(10.0, 40.0, 5.0)])
    assert list(found) == ['gyroscope']
    assert found['gyroscope'].pairs == 2
    assert found['gyroscope'].left == pytest.approx(np.zeros(3), abs=1e-12)
    spread = LINE_SLOPE * 30.0 / np.sqrt(12.0)  # of an even distribution over 30 K
    assert found['gyroscope'].raw == pytest.approx(np.full(3, spread), rel=0.03)
    assert found['gyroscope'].own == pytest.approx(np.full(3, 0.1))


def test_twice_the_slope_leaves_as_much_as_no_curve() -> None:
    found = on_other_logs([of_line(10.0, 40.0, 0.0, 2.0 * LINE_SLOPE)] * 2)['gyroscope']
    assert found.left == pytest.approx(found.raw)


def test_only_temperatures_that_both_have_seen_are_judged() -> None:
    wide, narrow = of_line(0.0, 60.0, 0.0), of_line(20.0, 32.0, 0.0)
    assert on_other_logs([wide, narrow])['gyroscope'].raw[0] == pytest.approx(
        LINE_SLOPE * 12.0 / np.sqrt(12.0), rel=0.1
    )
    assert on_other_logs([narrow, of_line(30.0, 60.0, 0.0)]) == {}
    assert on_other_logs([wide]) == {}
