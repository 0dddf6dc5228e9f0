# SPDX-License-Identifier: Apache-2.0
"""Bursts far apart: the scatter of their levels is noise, a knock between them is not."""

from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from scipy.signal import lfilter
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.noise.estimation import fit_noise
from thermal_comp.noise.of_runs import (
    LARGEST_AXIS_RATIO,
    determined_noise,
    log_prior_of_loudness,
    usual_noise,
)

from ..campaign import PERIOD, WHITE, chamber, run

WANDERING = 1.5 * WHITE['angular_velocity']
"""Standard deviation of slow noise of a few minutes, beside the noise of every run."""

CYCLES, HOUR = 8, 3600.0


def in_bursts(seed: int) -> ImuRecording:
    """A campaign of which 35 s in an hour were kept."""
    time = chamber(CYCLES)[0]
    keep = np.exp(-PERIOD / 200.0)
    drive = np.random.default_rng(seed).normal(size=(len(time), 3))
    wandering = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], drive, axis=0)
    whole = run('+z', seed=seed, cycles=CYCLES, error={'angular_velocity': WANDERING * wandering})
    return whole.rows(time % HOUR < 35.0)


@pytest.mark.long
def test_the_scatter_of_bursts_an_hour_apart_is_noise() -> None:
    slower = 0.16 * -np.expm1(-HOUR / np.array([200.0, 4000.0])).sum()
    truth = np.hypot(WANDERING, np.sqrt(slower) * WHITE['angular_velocity'])
    ratios = []
    for seed in range(8):
        noise = fit_noise(prepare([in_bursts(seed)]), 'gyroscope')
        apart = noise.amplitudes**2 * -np.expm1(-HOUR / noise.time_constants)[:, None]
        ratios.append(np.sqrt(apart.sum(axis=0)) / truth)
    assert np.sqrt(np.mean(np.log(ratios) ** 2)) < 0.22


def knocked(size: float) -> list[PreparedRun]:
    """Minutes of every hour, of a device that is knocked half way, by multiples of its noise."""
    time = chamber(CYCLES)[0]
    step = np.outer(time > time[-1] / 2.0, size * WHITE['angular_velocity'] * np.ones(3))
    whole = run('+z', seed=5, cycles=CYCLES, error={'angular_velocity': step})
    return prepare([whole.rows(time % HOUR < 200.0)])


@pytest.mark.long
def test_what_a_knock_makes_of_bursts_is_no_noise() -> None:
    base = {'gyroscope': (BiasTemperature(),)}
    for size, names in ((0.0, ()), (4.0, ('bias_step',)), (25.0, ('bias_step',))):
        runs = knocked(size)
        noise = determined_noise(runs, base)[0]
        answer = search_sensors(runs, base, noise, Settings(EFFECTS))['gyroscope']
        assert answer.likeliest.names == names


def test_noise_that_is_louder_than_usual_has_an_alternative() -> None:
    runs = knocked(0.0)
    fitted = fit_noise(runs, 'gyroscope')
    assert usual_noise(runs, 'gyroscope', fitted) is None
    loud = replace(
        fitted, white=1e-6 * fitted.white, amplitudes=20.0 * WANDERING * np.ones((7, 3))
    )
    usual = usual_noise(runs, 'gyroscope', loud)
    assert usual is not None
    assert usual.white == pytest.approx(WHITE['angular_velocity'], rel=0.3)
    assert usual.amplitudes == pytest.approx(np.tile(0.2 * usual.white, (7, 1)))
    assert usual_noise(runs, 'gyroscope', usual) is None


def test_bursts_of_one_block_that_scatter_more_than_their_rows_are_loud() -> None:
    """A supply that was not logged differs from burst to burst, and hardly within one."""
    time = chamber(4, 1.0)[0]
    burst = (time // 600.0).astype(int)
    levels = np.random.default_rng(7).normal(size=(burst.max() + 1, 3))
    error = 30.0 * WHITE['angular_velocity'] * levels[burst]
    for one, loud in ((run(period=1.0), False),
                      (run(period=1.0, error={'angular_velocity': error}), True)):  # fmt: skip
        runs = prepare([one.rows(time % 600.0 < 5.0)], period=5.0)
        assert (np.diff(runs[0].slot) > 1).all()
        usual = usual_noise(runs, 'gyroscope', fit_noise(runs, 'gyroscope'))
        assert (usual is not None) == loud
        if usual is not None:
            assert usual.white == pytest.approx(WHITE['angular_velocity'], rel=0.3)


def test_an_axis_far_noisier_than_the_others_from_row_to_row_is_loud() -> None:
    """A supply that was not logged goes up and down as fast as the rows: no noise of one axis."""
    time = chamber(CYCLES)[0]
    errors = np.random.default_rng(6).normal(size=(len(time), 1)) * [0.0, 0.0, 1.0]
    runs = {
        size: prepare([run(cycles=CYCLES, error={'angular_velocity': size * WANDERING * errors})])
        for size in (0.0, 30.0)
    }
    fitted = {size: fit_noise(some, 'gyroscope') for size, some in runs.items()}
    assert usual_noise(runs[0.0], 'gyroscope', fitted[0.0]) is None
    usual = usual_noise(runs[30.0], 'gyroscope', fitted[30.0])
    assert usual is not None
    assert usual.white.max() <= LARGEST_AXIS_RATIO * np.median(usual.white)


def test_noise_that_is_loud_along_one_axis_alone_is_less_likely_than_along_all() -> None:
    usual = fit_noise(knocked(0.0), 'gyroscope')

    def louder(*factors: float) -> float:
        noise = replace(
            usual, white=usual.white * factors, amplitudes=usual.amplitudes * np.array(factors)
        )
        return log_prior_of_loudness(noise, usual, PERIOD)

    assert louder(1.0, 1.0, 1.0) == 0.0 == louder(0.5, 1.0, 0.1)
    assert louder(1.0, 1.0, 64.0) < louder(4.0, 4.0, 4.0) < louder(2.0, 2.0, 2.0) < 0.0
