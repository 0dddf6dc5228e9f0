# SPDX-License-Identifier: Apache-2.0
"""Blocks of a run: measured, modelled and level add up to what was recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import PHASES
from imu_workbench.web.case.figures.run_blocks import blocks_of_runs
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ThermalModel

from imu_recording import ImuRecording

LINE = EFFECTS['bias_temperature']()


@pytest.fixture(scope='module')
def runs(run: Callable[..., ImuRecording]) -> list[PreparedRun]:
    return prepare([run(up=up, seed=k, cycles=2) for k, up in enumerate('xz')])


@pytest.fixture(scope='module')
def model(runs: list[PreparedRun]) -> ThermalModel:
    return fit_prepared((LINE, EFFECTS['turn_on_bias']()), runs)


def test_parts_add_up_and_leave_noise(runs: list[PreparedRun], model: ThermalModel) -> None:
    for prepared, blocks in zip(runs, blocks_of_runs(model, runs), strict=True):
        assert set(blocks.measured) == {'accelerometer', 'gyroscope', 'magnetometer'}
        for sensor, measured in blocks.measured.items():
            np.testing.assert_allclose(
                blocks.level[sensor] + measured, prepared.measured[sensor], rtol=1e-12
            )
            assert blocks.residual(sensor).mean(axis=0) == pytest.approx(
                np.zeros(3), abs=1e-9 * float(np.abs(blocks.level[sensor]).max())
            )
        x = blocks.residual('accelerometer')[:, 0]
        assert x.std() < 0.1 * blocks.measured['accelerometer'][:, 0].std()


def test_the_rate_is_that_of_the_ramp(runs: list[PreparedRun], model: ThermalModel) -> None:
    """60 K in three minutes, which the die follows 20 s behind."""
    blocks = blocks_of_runs(model, runs)[0]
    warming = blocks.phase == PHASES.index('ramp_up')
    assert np.median(blocks.rate[warming]) == pytest.approx(20.0, rel=0.1)
    assert (blocks.orientation, blocks.period) == ('+x', runs[0].period)


def test_some_of_the_blocks_keep_their_values(
    runs: list[PreparedRun], model: ThermalModel
) -> None:
    blocks = blocks_of_runs(model, runs)[0]
    hot = blocks.temperature > 40.0
    some = blocks.at(hot)
    assert len(some.time) == hot.sum() > 0
    assert (some.temperature > 40.0).all()
    np.testing.assert_array_equal(some.residual('gyroscope'), blocks.residual('gyroscope')[hot])
    assert some.level is blocks.level


def test_a_sensor_that_one_run_lacks_is_not_drawn(
    runs: list[PreparedRun], model: ThermalModel
) -> None:
    measured = {**runs[1].measured, 'magnetometer': np.full((len(runs[1]), 3), np.nan)}
    blind = replace(runs[1], measured=measured)
    for blocks in blocks_of_runs(model, [runs[0], blind]):
        assert set(blocks.measured) == {'accelerometer', 'gyroscope'}


def test_the_page_draws_the_residual_that_the_command_line_reports(fitted):
    for version in (fitted.line, fitted.lag):
        for sensor, part in version.comparison['sensors'].items():
            residual = np.concatenate([run.residual(sensor) for run in version.blocks])
            rms = np.sqrt(np.nanmean(residual**2, axis=0))
            assert rms == pytest.approx(part['residual_rms'], rel=1e-9)
