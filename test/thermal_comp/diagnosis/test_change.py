# SPDX-License-Identifier: Apache-2.0
"""A stored model is judged with the coefficients it holds: what changed since, and by how much."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.change import later_campaign
from thermal_comp.diagnosis.result import Diagnosis
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.model.values import ThermalModel

import thermal_comp as tc
from imu_recording import ImuRecording

from ..campaign import chamber, lagging, measured_by, run

UP = ('+x', '+z')


@cache
def stored() -> ThermalModel:
    return tc.fit([run(up, seed=k) for k, up in enumerate(UP)])


def later(**changes: object) -> Diagnosis:
    return tc.diagnose([run(up, seed=10 + k, **changes) for k, up in enumerate(UP)], stored())


def test_a_slope_half_as_large_again_is_found_with_its_ratio() -> None:
    found = later(slope_factor=1.5)
    assert found.verdict == 'changed'
    changes = {f.sensor: f for f in found.findings if f.kind == 'changed'}
    assert set(changes) == {'accelerometer', 'gyroscope', 'magnetometer'}
    for finding in changes.values():
        assert finding.name == 'bias_temperature'
        ratio = finding.parameters['ratio']
        assert ratio['value'] == pytest.approx(1.5, abs=0.02 + 2.0 * ratio['std'])


@pytest.mark.long
def test_another_campaign_of_the_same_device_has_not_changed() -> None:
    found = later()
    assert found.verdict == 'complete'
    assert not found.findings


@pytest.mark.long
def test_a_time_constant_that_moved_is_said_with_what_it_is_now() -> None:
    time, temperature, *_ = chamber()

    def lagged(time_constant: float, seed: int) -> list[ImuRecording]:
        behind = temperature - lagging(temperature, time_constant, float(time[1] - time[0]))
        error = {'angular_velocity': behind[:, None] * np.array([2e-4, -1e-4, 3e-4])}
        runs = [run(up, seed=seed + k, error=error) for k, up in enumerate(UP)]
        return measured_by(runs, 'gyroscope')

    effects = {'gyroscope': [BiasTemperature(), ThermalLag(300.0)]}
    model = tc.fit(lagged(300.0, 0), effects)
    now = tc.diagnose(lagged(420.0, 10), model)
    changes = {f.name: f for f in now.findings if f.kind == 'changed'}
    said = changes['thermal_lag'].parameters['time_constant']
    assert said['value'] == pytest.approx(420.0, abs=2.0 + 4.0 * said['std'])


def test_campaigns_that_lie_apart_and_differ_are_to_be_compared() -> None:
    january = run('+z', seed=1, cycles=1)
    autumn = run('+z', seed=2, cycles=1, slope_factor=1.4)
    autumn = replace(autumn, stamp=autumn.stamp + 200 * 86400 * 10**9, run='autumn')
    told = 'autumn begins 200 days after the runs before it'
    assert later_campaign(prepare([january, autumn])).startswith(told)
    assert later_campaign(prepare([january, replace(january, run='again')])) == ''
    only = measured_by([january, autumn], 'gyroscope')
    assert any(note.startswith(told) for note in tc.diagnose(only).notes)
