# SPDX-License-Identifier: Apache-2.0
"""Columns of effects over the runs of a campaign, as a diagnosis sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray
from scipy.ndimage import gaussian_filter1d

from thermal_comp.conditions import Conditions, Sensor
from thermal_comp.effects.effect import Effect
from thermal_comp.prepared_run import PreparedRun

SMOOTHING_S = 20.0
"""Standard deviation of the filter that tells the thermometer's noise from temperature [s] …"""
SMOOTHED_NOISE = 0.023
"""… where rows have this noise [K] …"""
SMOOTHED_PERIOD = 5.0
"""… and this distance [s].

A derivative through a Gaussian of width w carries noise of variance noise² · period / w³, corners
of the profile are blurred in proportion to w: the least sum lies at w⁴ ∝ noise² · period.
"""
NARROWEST, WIDEST = 5.0, 40.0
"""Bounds of the filter's width [s]."""


class ColumnSource:
    """Columns of effects as block means, kept, because several sensors and steps need the same.

    They are those of the smoothed temperature: a diagnosis has the whole run before it and need
    not be causal, and what the thermometer's noise does to rates, short lags and plays would make
    one of them look better than the other. The noise itself is a column of every bank.
    """

    def __init__(self, runs: Sequence[PreparedRun]) -> None:
        self.runs = list(runs)
        self.temperature_noise: list[FloatArray] = []
        """(m,) per run: smoothed minus measured temperature [K]."""
        self._smooth: list[PreparedRun] = []
        for run in self.runs:
            conditions = run.conditions
            smoothed = _smoothed(conditions)
            self.temperature_noise.append(run.block_mean(smoothed - conditions.temperature))
            self._smooth.append(replace(run, conditions=replace(conditions, temperature=smoothed)))
        self._kept: dict[tuple[Effect, Sensor], list[FloatArray]] = {}

    def columns(self, effect: Effect, sensor: Sensor) -> list[FloatArray]:
        """Return the effect's (m, p) or (m, 3, p) columns of each run."""
        key = (effect, sensor)
        if key not in self._kept:
            self._kept[key] = [
                run.block_mean(effect.columns_in_hindsight(run.conditions.of(sensor)))
                for run in self._smooth
            ]
        return self._kept[key]


def _smoothed(conditions: Conditions) -> FloatArray:
    """(n,) die temperature through a Gaussian as wide as its noise asks for."""
    step = float(np.median(np.diff(conditions.time)))
    width = smoothing_width(conditions.temperature, step)
    return np.asarray(gaussian_filter1d(conditions.temperature, width / step))


def smoothing_width(temperature: FloatArray, step: float) -> float:
    """Return the standard deviation of the filter [s] for rows `step` [s] apart."""
    bends = np.abs(np.diff(temperature, 2))
    noise = float(bends.mean() * np.sqrt(np.pi / 2.0 / 6.0)) if len(bends) else 0.0
    width = SMOOTHING_S * (noise / SMOOTHED_NOISE) ** 0.5 * (step / SMOOTHED_PERIOD) ** 0.25
    return float(np.clip(width, NARROWEST, WIDEST))
