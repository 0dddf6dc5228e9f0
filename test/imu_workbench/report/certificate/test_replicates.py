# SPDX-License-Identifier: Apache-2.0
"""Coefficients from each cycle alone: what was put in, where a cycle can tell it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import PHASES
from imu_workbench.report.certificate.replicates import own_terms, replicates
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit_prepared

from imu_recording import ImuRecording

LINE = EFFECTS['bias_temperature']()
BENT = (LINE, EFFECTS['bias_temperature_curvature']())
SLOPE = np.array([4e-5, -2e-5, 1e-5])
"""Of the gyroscope [rad/s/K]."""


def test_every_cycle_tells_level_and_slope(run: Callable[..., ImuRecording]) -> None:
    runs = prepare([run(up='x', seed=1, cycles=3), run(up='z', seed=2, cycles=2)])
    model = fit_prepared({'gyroscope': (LINE,)}, runs)
    found = replicates(model.sensors['gyroscope'], runs, 'gyroscope')
    assert found.run.tolist() == [0, 0, 0, 1, 1]
    assert found.parts == 'cycles'
    np.testing.assert_allclose(found.of(0, 0), np.tile(SLOPE, (5, 1)), atol=2e-6)
    np.testing.assert_allclose(found.level, np.zeros((5, 3)), atol=5e-5)


def test_a_cycle_that_differs_shows_alone(run: Callable[..., ImuRecording]) -> None:
    recording = run(cycles=3)
    extra = 1e-4 * (recording.temperature - 20.0) * (recording.cycle == 2)
    other = replace(recording, angular_velocity=recording.angular_velocity + extra[:, None])
    runs = prepare([other])
    model = fit_prepared({'gyroscope': (LINE,)}, runs)
    slopes = replicates(model.sensors['gyroscope'], runs, 'gyroscope').of(0, 0)
    assert slopes is not None
    np.testing.assert_allclose(slopes[1] - slopes[0], [1e-4] * 3, atol=3e-6)
    np.testing.assert_allclose(slopes[2], slopes[0], atol=3e-6)


def test_of_a_single_warm_up_parts_stand_in(run: Callable[..., ImuRecording]) -> None:
    recording = run(cycles=1)
    warming = recording.rows(np.flatnonzero(recording.phase == PHASES.index('ramp_up')))
    runs = prepare([replace(warming, cycle=None, phase=None, setpoint=None)], period=2.0)
    model = fit_prepared({'gyroscope': (LINE,)}, runs)
    found = replicates(model.sensors['gyroscope'], runs, 'gyroscope')
    assert found.parts == 'parts of a run'
    assert len(found.run) > 2
    np.testing.assert_allclose(found.of(0, 0).mean(axis=0), SLOPE, atol=1.2e-5)


@pytest.mark.parametrize('name', ['bias_step', 'warm_up'])
def test_what_a_cycle_cannot_tell_is_not_asked_of_it(
    name: str, run: Callable[..., ImuRecording]
) -> None:
    runs = prepare([run(cycles=2)])
    model = fit_prepared({'gyroscope': (*BENT, EFFECTS[name]())}, runs, refine=False)
    sensor = model.sensors['gyroscope']
    assert own_terms(sensor, runs, 'gyroscope') == [0, 1]
    found = replicates(sensor, runs, 'gyroscope')
    assert found.of(2, 0) is None
    assert found.of(1, 0) is not None
