# SPDX-License-Identifier: Apache-2.0
"""Shape parameters have a budget of their own: what single cycles and runs say of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.report.analysis import Analysis, analyse_recordings
from imu_workbench.report.certificate.joint_design import JointDesign
from imu_workbench.report.certificate.quantities import parts_differ, quantities
from imu_workbench.report.content import report_content
from imu_workbench.report.html.document import report_page
from imu_workbench.report.laboratory import Laboratory
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.operators import follow
from thermal_comp.fitting.fit import fit, fit_prepared

from imu_recording import ImuRecording

LINE, LAG = EFFECTS['bias_temperature'](), EFFECTS['thermal_lag'](90.0)
SIZE = np.array([3e-5, -2e-5, 1e-5])
"""Of the lag on the gyroscope [rad/s/K]."""


def lagging(recording: ImuRecording, *time_constants: float) -> ImuRecording:
    """Return the recording with a lag, of its own time constant in each cycle [s]."""
    error = np.zeros((len(recording.stamp), 3))
    for number, tau in enumerate(time_constants):
        lagged, _ = follow(recording.time, recording.temperature, tau, None)
        rows = recording.cycle >= number + 1 if number else np.ones(len(error), bool)
        error[rows] = np.outer(lagged - recording.temperature, SIZE)[rows]
    return replace(recording, angular_velocity=recording.angular_velocity + error)


@pytest.fixture(scope='module')
def recordings(run: Callable[..., ImuRecording]) -> list[ImuRecording]:
    """Two runs of three cycles, of which the second lags more slowly than the others."""
    return [lagging(run(up=up, seed=i, cycles=3), 80.0, 110.0, 80.0) for i, up in enumerate('xz')]


@pytest.fixture(scope='module')
def analysis(recordings: list[ImuRecording]) -> Analysis:
    """The report's analysis with the lag in the model."""
    model = fit({'gyroscope': [LINE, LAG], 'accelerometer': [LINE]}, recordings)
    return analyse_recordings(recordings, {'dut1': model}, attitudes=False, diagnosis=False)


def test_each_cycle_says_its_own_time_constant(recordings: list[ImuRecording]) -> None:
    runs = prepare(recordings)
    model = fit_prepared({'gyroscope': [LINE, LAG]}, runs)
    joint = JointDesign.of(model.sensors['gyroscope'], runs, 'gyroscope')
    (shape,) = joint.shapes
    changes, run = joint.scatter_of(joint.coefficients)
    assert run.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(shape.value + changes, [80, 110, 80] * 2, atol=9.0)


def test_its_budget_holds_the_scatter_of_the_cycles(recordings: list[ImuRecording]) -> None:
    runs = prepare(recordings)
    model = fit_prepared({'gyroscope': [LINE, LAG]}, runs)
    up = [r.up_axis for r in recordings]
    (found,) = (q for q in quantities(model, runs, up, Laboratory()) if q.shape)
    budget = found.budget
    assert found.coefficient == 'thermal_lag: time_constant'
    rows = {row.input.source: row.contribution for row in budget.rows}
    assert sum(v**2 for v in rows.values()) == pytest.approx(budget.combined**2, rel=1e-9)
    assert rows['repeatability over cycles'] == pytest.approx(30.0 / np.sqrt(18.0), rel=0.2)
    assert budget.degrees == pytest.approx(4.0, rel=0.3)  # six cycles of two runs
    assert budget.monte_carlo == pytest.approx(budget.combined, rel=0.05)
    assert abs(budget.value - 90.0) < budget.coverage_factor * budget.combined
    for source in ('thermometer calibration', 'gradient thermometer to die', 'reference'):
        assert budget.others[source] == 'does not act'


def test_a_width_feels_the_scale_of_the_thermometer(run: Callable[..., ImuRecording]) -> None:
    recording = run(cycles=3)
    runs = prepare([recording])
    effect = EFFECTS['thermal_hysteresis']((5.0,))
    columns = effect.columns(runs[0].conditions.of('gyroscope'))[0]
    error = runs[0].block_mean(columns) @ (3e-5 * np.ones((1, 3)))
    with_error = {**runs[0].measured, 'gyroscope': runs[0].measured['gyroscope'] + error}
    runs = [replace(runs[0], measured=with_error)]
    model = fit_prepared({'gyroscope': [LINE, effect]}, runs)
    stated = Laboratory({'thermometer': {'expanded_uncertainty': 0.4}})
    (width,) = (q for q in quantities(model, runs, ['+z'], stated) if q.shape)
    low, high = model.sensors['gyroscope'].temperature_range
    own = next(r for r in width.budget.rows if r.input.source == 'thermometer calibration')
    assert own.contribution == pytest.approx(
        width.budget.value * 0.2 * np.sqrt(2.0) / (high - low), rel=1e-6
    )


def test_page_one_states_its_uncertainty_and_freedom(analysis: Analysis) -> None:
    content = report_content(analysis, commands=['report'], versions={})
    found = content['certificates']['dut1']
    (lag,) = found['shapes']
    assert found['schema'] == 2
    assert lag.keys() == found['quantities'][0].keys()
    assert lag['degrees'] < 10.0
    page = report_page(content)
    result = page.partition('6 Result')[2].partition('7 Error')[0]
    assert 'thermal lag: time constant' in result
    assert f'k₉₅ {lag["coverage_factor"]:.2f}' in result
    expanded = f'{round(lag["expanded"])} s'
    assert expanded in found['conclusion']
    assert 'thermal lag: time constant' in page.partition('Uncertainty budgets')[2]


def test_a_model_without_it_says_that_it_is_not_told(analysis: Analysis) -> None:
    certified = analysis.certified['dut1']
    part = replace(certified.model.sensors['gyroscope'], shape_std={})
    bare = replace(certified.model, sensors={**certified.model.sensors, 'gyroscope': part})
    without = replace(analysis, certified={'dut1': replace(certified, model=bare)})
    content = report_content(without, commands=['report'], versions={})
    assert 'U not told' in report_page(content).partition('7 Error')[0]


def test_parts_that_differ_from_the_whole_show_a_wrong_form() -> None:
    assert parts_differ(np.array([1.0])) is None
    assert parts_differ(np.array([-1.0, 1.0])) == 0.0
    assert parts_differ(np.array([3.0, 3.0])) == pytest.approx(np.sqrt(3.0))
