# SPDX-License-Identifier: Apache-2.0
"""A run in blocks: their means, columns averaged over them, and what gaps leave unknown."""

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from scipy.signal import lfilter
from thermal_comp.comparison.held_out import hold_out
from thermal_comp.data.gaps import decays_after_gaps
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.fitting.fit import fit_prepared

import thermal_comp as tc

from .at_rest import still


def test_block_means_keep_the_mean_and_lose_the_noise() -> None:
    recording = still(1.0, 10.0)
    (run,) = prepare([recording], period=20.0)
    measured = run.measured['accelerometer']
    assert len(run) == 180
    np.testing.assert_allclose(
        measured.mean(axis=0), recording.linear_acceleration.mean(axis=0), rtol=1e-12
    )
    assert measured.std(axis=0) == pytest.approx(0.01 / np.sqrt(200), rel=0.25)


def test_columns_are_those_of_the_samples_averaged() -> None:
    recording = still(1.0, 0.5)
    (run,) = prepare([recording], period=20.0)
    column = run.columns(EFFECTS['bias_temperature'](), 'gyroscope')
    np.testing.assert_allclose(
        column[:, 0], (recording.temperature - 20.0).reshape(-1, 10).mean(axis=1), rtol=1e-12
    )


STEP = 5.0
TIME_CONSTANT = 400.0
NOISE = 2e-3


def recording_with_gaps() -> ImuRecording:
    """Eight hours of a lag behind swings of 1.5 h, without those about their turning points."""
    time = np.arange(0.0, 28_800.0, STEP)
    temperature = 20.0 + 15.0 * np.sin(2.0 * np.pi * time / 5400.0)
    share = 1.0 - np.exp(-STEP / TIME_CONSTANT)
    lagged = 20.0 + lfilter([share], [1.0, share - 1.0], temperature - 20.0)
    rng = np.random.default_rng(3)
    error = np.outer(temperature - 20.0, [2e-3, -1e-3, 1e-3])
    error += np.outer(lagged - temperature, [3e-3, 2e-3, -2e-3])
    unknown = np.full((len(time), 3), np.nan)
    whole = ImuRecording(
        stamp=(time * 1e9).astype(np.int64),
        linear_acceleration=[0.0, 0.0, 9.81] + error + rng.normal(0.0, NOISE, error.shape),
        angular_velocity=unknown,
        magnetic_field=unknown,
        temperature=temperature,
        device='dut1',
        up_axis='+z',
    )
    gaps = [(4000.0, 6500.0), (14_000.0, 17_200.0)]
    kept = np.all([(time < begin) | (time >= end) for begin, end in gaps], axis=0)
    return whole.rows(kept)


def test_a_time_constant_is_found_over_gaps_as_without_them() -> None:
    model = tc.fit([recording_with_gaps()], [BiasTemperature(), ThermalLag(200.0)])
    lag = next(e for e in model.sensors['accelerometer'].effects if isinstance(e, ThermalLag))
    std = model.sensors['accelerometer'].shape_std['thermal_lag.time_constant'][0]
    assert lag.time_constant == pytest.approx(TIME_CONSTANT, abs=3.0 * std)
    assert std < 0.05 * TIME_CONSTANT


def test_a_held_out_part_is_not_charged_with_what_nobody_knows() -> None:
    runs = prepare([recording_with_gaps()])
    effects = (BiasTemperature(), ThermalLag(TIME_CONSTANT))
    model = fit_prepared(effects, runs, refine=False)
    part = model.sensors['accelerometer']
    held = hold_out(runs, {'accelerometer': part.effects}, {'accelerometer': part.noise})
    assert np.all(held.rms('accelerometer') < 1.1 * held.floor('accelerometer'))
    assert np.all(held.rms('accelerometer') < 1.3 * NOISE / np.sqrt(runs[0].period / STEP))
    assert any('2 long gaps' in note for note in runs[0].notes)


def test_each_long_gap_leaves_decays_that_end() -> None:
    time = np.concatenate([np.arange(0.0, 3600.0, 20.0), np.arange(7200.0, 36_000.0, 20.0)])
    decays = decays_after_gaps(time)
    assert decays.shape == (len(time), 3)
    assert np.all(decays[time < 7200.0] == 0.0)
    assert np.all(decays[time == 7200.0] == 1.0)
    assert np.all(decays[-1] == 0.0)


def test_bursts_and_short_pauses_leave_none() -> None:
    bursts = np.add.outer(np.arange(0.0, 86_400.0, 3600.0), np.arange(0.0, 5.0, 0.2)).ravel()
    assert decays_after_gaps(bursts).shape == (len(bursts), 0)
    short = np.concatenate([np.arange(0.0, 3600.0, 20.0), np.arange(3700.0, 7200.0, 20.0)])
    assert decays_after_gaps(short).shape[1] == 0
    often = np.add.outer(np.arange(0.0, 86_400.0, 1800.0), np.arange(0.0, 600.0, 20.0)).ravel()
    assert decays_after_gaps(often).shape[1] == 0
    hourly = np.arange(0.0, 864_000.0, 600.0)
    assert decays_after_gaps(hourly).shape[1] == 0
