# SPDX-License-Identifier: Apache-2.0
"""A small version of the benchmark of curves from still minutes."""

from __future__ import annotations

import numpy as np
import pytest
from still_logs import SENSORS, chamber_run, draw_device, left_in, still_of
from thermal_comp.model.values import SensorModel, ThermalModel


@pytest.mark.long
def test_ten_flights_tell_most_of_the_curve_and_their_bands_hold() -> None:
    device = draw_device(4)
    curves = still_of(device, 10, 20.0, seed=4)
    visited = curves.temperature[curves.minutes > 0.0]
    fresh = chamber_run(device, 2, 1, np.random.default_rng(4))
    inside = float(visited[0]), float(visited[-1])
    left = left_in(curves.model, fresh, inside)
    none = SensorModel((), (), np.zeros((0, 0)))
    raw = left_in(ThermalModel('', dict.fromkeys(SENSORS, none)), fresh, inside)
    grid = np.arange(np.ceil(inside[0]), inside[1])
    true = {s: device.curve[s](np.append(grid, curves.base)) for s in SENSORS}
    for sensor in SENSORS:
        assert np.linalg.norm(left[sensor]) < 0.1 * np.linalg.norm(raw[sensor])
        value, std = curves.curve(sensor, grid)
        off = np.abs(value - (true[sensor][:-1] - true[sensor][-1]))
        assert np.mean(off <= 1.96 * std) > 0.7
        assert np.mean(off <= 4.0 * std) > 0.97
        assert (std[np.abs(grid - curves.base) > 1.0] > 0.0).all()
        part = curves.sensors[sensor]
        assert np.linalg.norm(part.held_out) < np.linalg.norm(part.raw)
