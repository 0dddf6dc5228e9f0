# SPDX-License-Identifier: Apache-2.0
"""What the autopilots' scripts fit, against their definitions written out sample by sample."""

from __future__ import annotations

import numpy as np
from thermal_comp.data.conditions import Sensor
from thermal_comp.second_opinion.autopilot_fit import ardupilot_fit, px4_fit

RNG = np.random.default_rng(5)
TIME = np.arange(3000) / 10.0
TEMPERATURE = 5.0 + 40.0 * (1.0 - np.exp(-TIME / 120.0)) + RNG.normal(0.0, 0.02, len(TIME))
VALUES = np.stack([0.02 * TEMPERATURE, 1e-4 * TEMPERATURE**2, np.sin(TEMPERATURE / 9.0)], axis=1)
VALUES += RNG.normal(0.0, 0.01, VALUES.shape)


def test_px4_median_bins_and_cubic() -> None:
    sensors: tuple[Sensor, ...] = ('accelerometer', 'gyroscope')
    for sensor in sensors:
        cubic = px4_fit(TIME, TEMPERATURE, VALUES, sensor)
        assert (cubic.low, cubic.high) == (TEMPERATURE.min(), TEMPERATURE.max())
        assert cubic.reference == 0.5 * (cubic.low + cubic.high)
        for axis in range(3):
            padded = np.concatenate([np.zeros(15), VALUES[:, axis], np.zeros(15)])
            smooth = np.array([np.median(padded[k : k + 31]) for k in range(len(TIME))])
            if sensor == 'accelerometer':
                smooth = smooth - np.median(smooth)
            bins: dict[int, list[tuple[float, float]]] = {}
            x = TEMPERATURE - cubic.reference
            for one, value in zip(x, smooth, strict=True):
                place = int((one - x.min()) / ((x.max() - x.min()) / 2000))
                bins.setdefault(min(place, 1999), []).append((one, value))
            means = np.array([np.mean(pairs, axis=0) for pairs in bins.values()])
            expected = np.polyfit(means[:, 0], means[:, 1], 3)[::-1]
            np.testing.assert_allclose(
                cubic.coefficients[:, axis], expected, rtol=1e-6, atol=1e-15
            )


def test_ardupilot_moving_average_about_35_degrees_rounded() -> None:
    cubic = ardupilot_fit(TIME, TEMPERATURE, VALUES, 'gyroscope')
    window = np.ones(20) / 20.0  # 2 s of 10 Hz
    temperature = np.convolve(TEMPERATURE, window, 'valid')
    assert cubic.reference == 35.0
    assert (cubic.low, cubic.high) == (round(temperature.min(), 1), round(temperature.max(), 1))
    for axis in range(3):
        smooth = np.convolve(VALUES[:, axis], window, 'valid')
        expected = np.polyfit(temperature - 35.0, smooth, 3)[::-1]
        assert cubic.coefficients[0, axis] == 0.0
        np.testing.assert_allclose(
            1e6 * cubic.coefficients[1:, axis], 1e6 * expected[1:], rtol=1e-6, atol=1e-9
        )
