# SPDX-License-Identifier: Apache-2.0
"""What a basis follows of an effect, and that projections of a run are kept."""

import numpy as np
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.noise.process import correlation_times
from thermal_comp.noise.projection import not_followed, projection_of
from thermal_comp.noise.saturated_model import SaturatedModel

from ..campaign import run

EFFECTS_TRIED = [EFFECTS['bias_temperature'](), EFFECTS['bias_step'](step_time=(9000.0,))]


def test_a_saturated_model_follows_a_line_and_no_step() -> None:
    runs = prepare([run('+z', cycles=2)])
    (step,) = not_followed(runs, 'gyroscope', EFFECTS_TRIED, SaturatedModel())
    assert step.name == 'bias_step'


def test_a_projection_takes_out_the_basis_and_what_is_beside_it_and_is_kept() -> None:
    (prepared,) = prepare([run('+z', cycles=2)])
    valid = np.arange(len(prepared)) > 10
    step, repeatable = EFFECTS_TRIED[1], SaturatedModel(over_time=False)
    further = {('gyroscope', step): prepared.columns(step, 'gyroscope')}
    times = correlation_times(float(prepared.time[-1]))
    found = projection_of(prepared, valid, repeatable, further, None, times)
    assert projection_of(prepared, valid, repeatable, further, None, times) is found
    alone = projection_of(prepared, valid, repeatable, {}, None, times)
    assert found.basis.shape[1] == alone.basis.shape[1] + 1
    left = found.spectrum_of(prepared.columns(step, 'gyroscope').reshape(-1, 1)[valid])
    assert left.periodogram.max() < 1e-12
