# SPDX-License-Identifier: Apache-2.0
"""Coefficients from each cycle alone: what was put in, where a cycle can tell it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from imu_recording.recording import PHASES
from imu_workbench.report.certificate.joint_design import coefficient_columns, place_of
from imu_workbench.report.certificate.quantities import quantities
from imu_workbench.report.certificate.replicates import own_terms, replicates
from imu_workbench.report.laboratory import Laboratory
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


def test_the_heater_s_field_is_neither_scatter_nor_form(run: Callable[..., ImuRecording]) -> None:
    """What the model has of the chamber is taken out before cycles and ends are compared."""
    recordings = []
    for seed, up in enumerate('xyz'):
        recording = run(up=up, seed=seed, cycles=3)
        heater = ((recording.temperature > 30.0) & (recording.cycle != 2)).astype(float)
        field = recording.magnetic_field + heater[:, None] * 1e-6
        recordings.append(replace(recording, heater=heater, magnetic_field=field))
    runs = prepare(recordings)
    heated = (LINE, EFFECTS['heater_hard_iron']())
    model = fit_prepared({'magnetometer': heated}, runs)
    slopes = replicates(model.sensors['magnetometer'], runs, 'magnetometer').of(0, 0)
    assert slopes is not None
    np.testing.assert_allclose(slopes, np.tile([2e-7, -1e-7, 3e-7], (9, 1)), atol=2e-9)
    up_axes = [r.up_axis for r in recordings]
    found = quantities(model, runs, up_axes, Laboratory())
    forms = [
        row.contribution
        for slope in found
        if (slope.sensor, slope.coefficient) == ('magnetometer', 'slope')
        for row in slope.budget.rows
        if row.input.source == 'model form'
    ]
    assert len(forms) == 3
    assert max(forms) < 5e-10  # a microtesla in the hot third of 60 K


def test_what_runs_have_of_their_own_says_nothing_of_another(
    run: Callable[..., ImuRecording],
) -> None:
    runs = prepare([run(up='x', seed=1, cycles=3), run(up='z', seed=2, cycles=3)])
    effect = EFFECTS['turn_on_bias']()
    model = fit_prepared({'gyroscope': (LINE, effect)}, runs)
    part = model.sensors['gyroscope']
    values = part.coefficients[1]
    first, other = (
        coefficient_columns(runs[0], 'gyroscope', effect, values, place) for place in (0, None)
    )
    assert first.any()
    assert not other.any()
    renamed = replace(runs[0], name='another')
    assert [place_of(r, part) for r in (*runs, renamed)] == [0, 1, None]
