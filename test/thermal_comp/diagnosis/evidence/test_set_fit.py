# SPDX-License-Identifier: Apache-2.0
"""A set is fitted to the best shapes and amplitudes of its effects."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.diagnosis.evidence.candidates import form_of
from thermal_comp.diagnosis.evidence.priors import AMPLITUDES
from thermal_comp.diagnosis.evidence.set_fit import fitted_set, scaled
from thermal_comp.effects import EFFECTS

from ..one_run import lagging_gyroscope


def test_a_shape_far_from_the_truth_moves_there() -> None:
    answer = lagging_gyroscope()
    (lag,) = next(s for s in answer.sets if s.names == ('thermal_lag',)).components
    hypotheses = answer.hypotheses
    hypotheses.fits.clear()
    form = form_of(hypotheses.design, EFFECTS['thermal_lag'](700.0), None)
    far = replace(lag, form=form)
    fitted = fitted_set(hypotheses, [far])
    assert fitted.components[0].form.effect.time_constant == pytest.approx(300.0, rel=0.1)


def test_the_amplitude_is_the_likeliest_of_the_grid() -> None:
    answer = lagging_gyroscope()
    hypotheses = answer.hypotheses
    (lag,) = next(s for s in answer.sets if s.names == ('thermal_lag',)).components
    ((best,), total) = scaled(hypotheses, [replace(lag, amplitude=float(AMPLITUDES[0]))], 0)
    each = [
        hypotheses.joint([replace(lag, amplitude=a)], hypotheses.likeliest_nuisances([lag]))[0]
        for a in AMPLITUDES.tolist()
    ]
    assert best.amplitude == pytest.approx(AMPLITUDES[int(np.argmax(each))])
    assert total >= 0.0  # a sum over amplitudes, relative to its largest part
