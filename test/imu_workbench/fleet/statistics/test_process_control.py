# SPDX-License-Identifier: Apache-2.0
"""Capability of drawn devices under a file of limits; charts of drawn values with known faults."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_workbench.fleet.statistics.process_control import capabilities, control_chart
from imu_workbench.report.limits import read_limits

LIMITS = """
schema: 1
limits:
  accelerometer:
    slope: {lower: -1, upper: 1, unit: mg/K}
  gyroscope:
    slope: {upper: 0.01, unit: °/s/K}
"""


def population(sensor: str, mean: np.ndarray, std: np.ndarray, devices: int = 200):
    return {
        'type': 'none', 'lot': 'A', 'sensor': sensor, 'devices': devices,
        'mean': mean.tolist(), 'std': std.tolist(),
    }  # fmt: skip


def test_limits_in_mg_decide_on_slopes_in_si(tmp_path: Path) -> None:
    file = tmp_path / 'limits.yaml'
    file.write_text(LIMITS)
    mg = 9.80665e-3
    lots = [
        population('accelerometer', mg * np.array([0.0, 0.5, 1.2]), mg * np.full(3, 0.1)),
        population('gyroscope', np.zeros(3), np.full(3, np.radians(0.01) / 6.0)),
        population('magnetometer', np.zeros(3), np.ones(3)),
    ]
    found = capabilities(lots, read_limits(file))
    index = {(c.sensor, c.axis): c.cpk for c in found}
    assert index['accelerometer', 'x'] == pytest.approx(1.0 / 0.3)
    assert index['accelerometer', 'y'] == pytest.approx(0.5 / 0.3)
    assert index['accelerometer', 'z'] == pytest.approx(-0.2 / 0.3)  # the mean is outside
    assert index['gyroscope', 'y'] == pytest.approx(2.0)  # one limit alone
    assert found[0].axis == 'z'  # worst first
    assert {c.sensor for c in found} == {'accelerometer', 'gyroscope'}
    assert {c.axis for c in found if c.sensor == 'accelerometer' and c.capable} == {'x', 'y'}


def test_the_interval_holds_the_index_of_drawn_lots(tmp_path: Path) -> None:
    file = tmp_path / 'limits.yaml'
    file.write_text(LIMITS)
    limits = read_limits(file)
    rng, inside, lots, devices = np.random.default_rng(4), 0, 400, 60
    mg, true = 9.80665e-3, 1.5
    for _ in range(lots):
        drawn = rng.normal(0.0, mg / (3.0 * true), (devices, 3))
        lot = population('accelerometer', drawn.mean(axis=0), drawn.std(axis=0, ddof=1), devices)
        low, high = next(c.interval for c in capabilities([lot], limits) if c.axis == 'x')
        inside += low <= true <= high
    assert 0.9 < inside / lots <= 1.0


def test_a_control_chart_sees_a_step_and_a_wild_value() -> None:
    draw = np.random.default_rng(5)
    values = draw.normal(size=200)
    assert len(control_chart(values).beyond) <= 3
    values[50] = 9.0
    values[150:] += 2.0
    chart = control_chart(values)
    assert 50 in chart.beyond
    assert any(place > 155 for place in chart.on_one_side)
