# SPDX-License-Identifier: Apache-2.0
"""The noise of a model as Kalibr's imu.yaml has it: a density and a random walk per sensor."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import INERTIAL_SENSORS
from thermal_comp.model.values import ModelError, NoiseModel, ThermalModel

HORIZON_S = 100.0
"""Correlation time from which a process counts as random walk, below as white noise [s]."""


def densities(noise: NoiseModel) -> tuple[FloatArray, FloatArray]:
    """Return (3,) noise density [unit/√Hz] and random walk [unit/s/√Hz] of each axis.

    An Ornstein-Uhlenbeck process of deviation σ and correlation time τ has the density 2σ²τ far
    below 1/τ and grows like a random walk of 2σ²/τ at first (Gelb, Applied Optimal Estimation,
    1974, ch. 2): within a horizon of 100 s the slow ones are the walk, the fast ones white.
    """
    tau, variance = noise.time_constants[:, None], noise.amplitudes**2
    slow = tau > HORIZON_S
    white = noise.white**2 + (np.where(slow, 0.0, 2.0 * tau) * variance).sum(axis=0)
    walk = (np.where(slow, 2.0 / tau, 0.0) * variance).sum(axis=0)
    return np.sqrt(white), np.sqrt(walk)


def kalibr_text(model: ThermalModel, rate: float, topic: str, label: str) -> str:
    """Return imu.yaml, the worst axis of each sensor; `rate` [Hz] is that of the topic.

    Raises ModelError where a sensor or its noise is missing, or has no random walk.
    """
    lines = [f'# Noise of {label}', '# of what is left once the temperature error is subtracted.']
    units = (('m/s^2', 'm/s^3'), ('rad/s', 'rad/s^2'))
    for sensor, (unit, rate_of_unit) in zip(INERTIAL_SENSORS, units, strict=True):
        part = model.sensors.get(sensor)
        if part is None or part.noise is None:
            raise ModelError(f'sensors.{sensor}.noise: missing; Kalibr needs it')
        white, walk = densities(part.noise)
        if not (white.max() > 0.0 and walk.max() > 0.0):
            raise ModelError(
                f'sensors.{sensor}.noise: no random walk; record an hour or more and fit again'
            )
        lines += [
            f'{sensor}_noise_density: {white.max():.6e}  # [{unit}/sqrt(Hz)]',
            f'{sensor}_random_walk: {walk.max():.6e}  # [{rate_of_unit}/sqrt(Hz)]',
        ]
    lines += [f'rostopic: {topic}', f'update_rate: {rate:.10g}  # [Hz]']
    return '\n'.join(lines) + '\n'
