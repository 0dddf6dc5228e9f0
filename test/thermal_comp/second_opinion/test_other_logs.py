# SPDX-License-Identifier: Apache-2.0
"""The curve of one log judged on the others: levels are no error, another slope is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from thermal_comp.export.cubic import Cubic
from thermal_comp.second_opinion.opinion import SecondOpinion, SensorOpinion
from thermal_comp.second_opinion.other_logs import on_other_logs

SLOPE = 2e-3
"""Of every axis [rad/s/K]."""


def opinion(low: float, high: float, level: float, fitted: float = SLOPE) -> SecondOpinion:
    """A log without noise from one temperature to another, and a line of slope `fitted`."""
    temperature = np.linspace(low, high, 61)
    measured = level + SLOPE * np.outer(temperature, np.ones(3))
    line = np.zeros((4, 3))
    line[1] = fitted
    error = np.full(3, 0.1)
    judged = SensorOpinion(Cubic(line, 0.0, low, high), error, error, error, error)
    run = SimpleNamespace(measured={'gyroscope': measured}, temperature=temperature)
    return SecondOpinion('quad', 'px4', (low, high), 0.0, {'gyroscope': judged}, run)


def test_the_right_curve_leaves_nothing_whatever_the_levels() -> None:
    found = on_other_logs([opinion(10.0, 40.0, 0.0), opinion(10.0, 40.0, 5.0)])
    assert list(found) == ['gyroscope']
    assert found['gyroscope'].pairs == 2
    assert found['gyroscope'].left == pytest.approx(np.zeros(3), abs=1e-12)
    spread = SLOPE * 30.0 / np.sqrt(12.0)  # of an even distribution over 30 K
    assert found['gyroscope'].raw == pytest.approx(np.full(3, spread), rel=0.03)
    assert found['gyroscope'].own == pytest.approx(np.full(3, 0.1))


def test_twice_the_slope_leaves_as_much_as_no_curve() -> None:
    found = on_other_logs([opinion(10.0, 40.0, 0.0, 2.0 * SLOPE)] * 2)['gyroscope']
    assert found.left == pytest.approx(found.raw)


def test_only_temperatures_that_both_have_seen_are_judged() -> None:
    wide, narrow = opinion(0.0, 60.0, 0.0), opinion(20.0, 32.0, 0.0)
    assert on_other_logs([wide, narrow])['gyroscope'].raw[0] == pytest.approx(
        SLOPE * 12.0 / np.sqrt(12.0), rel=0.1
    )
    assert on_other_logs([narrow, opinion(30.0, 60.0, 0.0)]) == {}
    assert on_other_logs([wide]) == {}
