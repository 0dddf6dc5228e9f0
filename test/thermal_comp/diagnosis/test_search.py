# SPDX-License-Identifier: Apache-2.0
"""What the form of a known effect leaves is no further effect."""

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.search import FORM_SHARE, NESTED_SHARE, least_delta_chi2
from thermal_comp.effects import EFFECTS
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.noise.estimation import fit_noise

from ..campaign import chamber, run


def test_a_richer_effect_has_to_gain_a_share_of_the_known_one() -> None:
    time, die, *_ = chamber(3)
    error = 2e-2 * np.gradient(die, time)[:, None] * np.ones(3)
    recordings = [run('+z', seed=k, cycles=3, error={'angular_velocity': error}) for k in (0, 1)]
    runs = prepare(recordings)
    noise = fit_noise(runs, 'gyroscope')
    source = ColumnSource(runs)
    line, rate = EFFECTS['bias_temperature'](), EFFECTS['temperature_rate']()
    assert least_delta_chi2(source, 'gyroscope', noise, [line], EFFECTS) == {}
    least = least_delta_chi2(source, 'gyroscope', noise, [line, rate], EFFECTS)
    lost = CandidateDesign(source, 'gyroscope', noise, [line]).chi_square
    left = CandidateDesign(source, 'gyroscope', noise, [line, rate]).chi_square
    assert lost > 3.0 * left
    assert least['thermal_gradient'] == pytest.approx(FORM_SHARE * (lost - left), rel=1e-3)
    assert least['thermal_lag'] == pytest.approx(NESTED_SHARE * (lost - left), rel=1e-3)
