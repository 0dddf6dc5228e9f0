# SPDX-License-Identifier: Apache-2.0
"""The conclusion of a certificate: what is approximate, not lowered, still missing."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from imu_workbench.report.certificate.conclusion import (
    approximate_forms,
    conclusion,
    still_missing,
)
from thermal_comp.effects.thermal_lag import ThermalLag


@pytest.mark.parametrize('approximate', [False, True])
def test_a_form_is_called_approximate_where_the_diagnosis_says_so(analysis, approximate) -> None:
    certified = replace(analysis.certified['dut1'], added=('bias_temperature (accelerometer)',))
    explained = {
        'sensor': 'accelerometer',
        'names': ['bias_temperature'],
        'approximate': approximate,
    }
    rival = {'sensor': 'accelerometer', 'names': ['icing'], 'approximate': True}
    found = approximate_forms(certified, {'explanations': [explained, rival]})
    assert set(found) == ({'bias_temperature'} if approximate else set())
    assert approximate_forms(certified, None) == {}


@pytest.mark.parametrize(
    ('ratio', 'reason'),
    [(1.3, 'leaves more than noise'), (1.0, 'is probably off, by less than the noise')],
)
def test_the_conclusion_says_why_a_form_is_approximate(analysis, ratio, reason) -> None:
    dut1 = analysis.certified['dut1']
    part = dut1.model.sensors['accelerometer']
    lagging = replace(part, effects=(*part.effects, ThermalLag(70.0)))
    sensors = {**dut1.model.sensors, 'accelerometer': lagging}
    compared = dut1.comparison.sensors['accelerometer']
    left = replace(compared, held_out_rms=compared.noise_floor * (0.9, ratio, 0.9))
    certified = replace(
        dut1,
        model=replace(dut1.model, sensors=sensors),
        comparison=replace(dut1.comparison, sensors={'accelerometer': left}),
        added=('thermal_lag (accelerometer)',),
    )
    explained = {'sensor': 'accelerometer', 'names': ['thermal_lag'], 'approximate': True}
    diagnosis = {'explanations': [explained], 'steps': [], 'findings': []}
    said = conclusion(certified, [], [], [], diagnosis, (-10.0, 50.0))
    assert f'form approximate: its equation {reason}' in said
    exact = diagnosis | {'explanations': [explained | {'approximate': False}]}
    assert 'approximate' not in conclusion(certified, [], [], [], exact, (-10.0, 50.0))


def test_the_conclusion_says_where_the_error_does_not_fall(analysis) -> None:
    certified = analysis.certified['dut1']
    row = {'sensor': 'gyroscope', 'before': 2.0, 'after': 1.0, 'ratio': 1.0}
    rows = [row | {'axis': 'x'}, row | {'axis': 'z', 'before': 0.9}]
    said = conclusion(certified, [], rows, [], None, (0.0, 40.0))
    assert 'does not lower the error of gyroscope z;' in said
    assert 'does not lower' not in conclusion(certified, [], rows[:1], [], None, (0.0, 40.0))


def test_what_was_added_is_not_called_missing() -> None:
    added = SimpleNamespace(added=('thermal_lag',))
    lag = {
        'kind': 'effect',
        'sensor': 'accelerometer',
        'text': 'accelerometer: thermal_lag is missing',
    }
    other = {
        'kind': 'unlogged',
        'sensor': 'gyroscope',
        'text': 'gyroscope: a variable acts: chamber (60 %)',
    }
    diagnosis = {'steps': [], 'verdict': 'missing', 'findings': [lag]}
    assert not still_missing(added, diagnosis)
    both = diagnosis | {'findings': [lag, other]}
    assert still_missing(added, both) == 'gyroscope: a variable acts: chamber'
