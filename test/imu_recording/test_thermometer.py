# SPDX-License-Identifier: Apache-2.0
"""A thermometer that stands still, has no value or counts whole degrees is at fault."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from imu_recording.thermometer import LiveThermometer, is_constant, is_whole_degrees

SECOND = 1_000_000_000


def fault_after(values: Iterable[float], step: int = SECOND) -> str:
    thermometer = LiveThermometer()
    for k, value in enumerate(values):
        thermometer.add(k * step, value)
    return thermometer.fault


def test_counts_that_scatter_are_in_order() -> None:
    values = 20.0 + np.random.default_rng(1).integers(-2, 3, 2000) / 16.0
    assert fault_after(values.tolist()) == ''


def test_one_value_is_a_fault_after_ten_minutes_of_fifty_samples() -> None:
    assert fault_after([25.0625] * 590) == ''
    assert fault_after([25.0625] * 602) == 'the thermometer stands at 25.0625 °C for 10 min'
    assert fault_after([25.0625] * 49, 60 * SECOND) == ''


def test_a_value_missing_for_twenty_rows_is_a_fault_until_the_next() -> None:
    assert fault_after([20.5, *[np.nan] * 19]) == ''
    assert fault_after([20.5, *[np.nan] * 20]) == 'the thermometer has no value (NaN)'
    assert fault_after([20.5, *[np.nan] * 20, 20.5]) == ''


def test_a_clock_set_back_begins_anew() -> None:
    thermometer = LiveThermometer()
    for stamp in [*range(1000, 1500), *range(599)]:
        thermometer.add(stamp * SECOND, 30.25)
    assert thermometer.fault == ''


@pytest.mark.parametrize(
    ('values', 'whole'),
    [([20.0, 21.0, 20.0], True), ([20.0, 20.5, 21.0], False), ([20.0, 20.0], False)],
)
def test_whole_degrees_change(values: list[float], whole: bool) -> None:
    assert is_whole_degrees(np.array(values)) is whole


def test_a_degree_in_single_precision_is_whole() -> None:
    assert is_whole_degrees(np.array([20.0, 21.0 + 5e-7]))
    half = [20.0 + 0.5 * (k % 2) for k in range(100)]
    assert fault_after(half) == ''
    assert fault_after([20.0 + k // 30 for k in range(60)]) == 'temperature in whole degrees'


def test_nothing_is_not_constant() -> None:
    assert not is_constant(np.empty(0))
    assert is_constant(np.array([3.0, 3.0]))
    assert not is_constant(np.array([3.0, np.nan]))
