# SPDX-License-Identifier: Apache-2.0
"""Spectrum and Allan deviation agree with noise that was drawn."""

from __future__ import annotations

import numpy as np
import pytest
from imu_workbench.web.case.figures.noise import (
    allan_variance,
    noise_allan_variance,
    noise_density,
)
from thermal_comp.model.values import NoiseModel


def test_noise_curves_agree_with_noise_that_was_drawn():
    rng = np.random.default_rng(3)
    noise = NoiseModel(np.full(3, 2e-3), np.array([300.0]), np.full((1, 3), 5e-4))
    period, n = 20.0, 40_000
    decay = np.exp(-period / 300.0)
    steps = rng.normal(0.0, 5e-4 * np.sqrt(1.0 - decay**2), n)
    slow = np.zeros(n)
    for k in range(1, n):
        slow[k] = decay * slow[k - 1] + steps[k]
    values = slow + rng.normal(0.0, 2e-3 / np.sqrt(period), n)
    tau, variance, _ = allan_variance(values, period)
    expected = noise_allan_variance(noise, 0, tau)
    assert variance[:8] == pytest.approx(expected[:8], rel=0.2)
    frequency = np.fft.rfftfreq(n, period)[1:]
    power = 2.0 * period * np.abs(np.fft.rfft(values))[1:] ** 2 / n
    low = frequency < 5e-4
    assert power[low].mean() == pytest.approx(
        noise_density(noise, 0, frequency[low], period).mean(), rel=0.1
    )
