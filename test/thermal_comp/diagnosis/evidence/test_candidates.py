# SPDX-License-Identifier: Apache-2.0
"""The likeliest steps that forms of effects are chosen from."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence.candidates import STEP_DURATIONS_S, _rises, form_of
from thermal_comp.effects.bias_temperature_curvature import BiasTemperatureCurvature
from thermal_comp.effects.operators import rise
from thermal_comp.effects.thermal_lag_two_stage import ThermalLagTwoStage
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.noise.estimation import fit_noise

from ...campaign import run


@pytest.fixture(scope='module')
def prepared() -> PreparedRun:
    whole = run('+z', seed=1, cycles=2)
    gap = np.arange(len(whole)) // 700 != 3
    return prepare([whole.rows(gap)], period=20.0)[0]


@pytest.mark.parametrize('share', [0.0, 0.2, 0.6, 0.999])
def test_rises_are_those_over_the_whole_run(prepared: PreparedRun, share: float) -> None:
    time = prepared.conditions.time
    start = max(float(share * prepared.time[-1]) - 30.0, 0.0)
    forms = [(start + k * 7.0, d) for k in range(4) for d in STEP_DURATIONS_S]
    whole = prepared.block_mean(np.stack([rise(time, *form) for form in forms], axis=1))
    first, means = _rises(prepared, forms)
    assert not whole[:first].any()
    np.testing.assert_array_equal(means, whole[first:])


def test_coefficients_of_one_unit_are_equally_large_beforehand(prepared: PreparedRun) -> None:
    noise = fit_noise([prepared], 'gyroscope', ())
    design = CandidateDesign(ColumnSource([prepared]), 'gyroscope', noise, ())
    fast, slow = form_of(design, ThermalLagTwoStage(30.0, 1500.0), None).relative
    assert slow == 1.0
    assert 0.0 < fast < 0.1  # a lag of half a minute explains less than one of half an hour
    same = form_of(design, ThermalLagTwoStage(600.0, 1600.0), None).relative
    assert min(same) > 0.3
    assert form_of(design, BiasTemperatureCurvature(), None).relative == (1.0, 1.0)
