# SPDX-License-Identifier: Apache-2.0
"""Bursts far apart: how their levels scatter is noise, and none is taken out."""

import numpy as np
from imu_recording.recording import ImuRecording
from scipy.signal import lfilter
from thermal_comp.data.preparation import prepare
from thermal_comp.noise.estimation import fit_noise

from ..campaign import PERIOD, WHITE, chamber, run

WANDERING = 1.5 * WHITE['angular_velocity']
"""Standard deviation of what wanders within minutes, beside the noise of every run."""

CYCLES, HOUR = 8, 3600.0


def in_bursts(seed: int) -> ImuRecording:
    """A campaign of which 35 s in an hour were kept."""
    time = chamber(CYCLES)[0]
    keep = np.exp(-PERIOD / 200.0)
    drive = np.random.default_rng(seed).normal(size=(len(time), 3))
    wandering = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], drive, axis=0)
    whole = run('+z', seed=seed, cycles=CYCLES, error={'angular_velocity': WANDERING * wandering})
    return whole.rows(time % HOUR < 35.0)


def test_the_scatter_of_bursts_an_hour_apart_is_noise() -> None:
    slower = 0.16 * -np.expm1(-HOUR / np.array([200.0, 4000.0])).sum()
    truth = np.hypot(WANDERING, np.sqrt(slower) * WHITE['angular_velocity'])
    ratios = []
    for seed in range(8):
        noise = fit_noise(prepare([in_bursts(seed)]), 'gyroscope')
        apart = noise.amplitudes**2 * -np.expm1(-HOUR / noise.time_constants)[:, None]
        ratios.append(np.sqrt(apart.sum(axis=0)) / truth)
    assert np.sqrt(np.mean(np.log(ratios) ** 2)) < 0.22
