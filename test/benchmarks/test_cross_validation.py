# SPDX-License-Identifier: Apache-2.0
"""Parameters chosen without the trial they are judged on."""

from __future__ import annotations

import numpy as np
import pytest
from cross_validation import CrossValidation, step_of, value_of
from imu_recording.recording import FloatArray

OPTIMA = np.array([0.02, 0.02, 0.02, 5.0])
"""Of the parameter, by trial: the last one is unlike the others."""


def errors_of(values: dict[str, float]) -> FloatArray:
    return 1.0 + np.log(values['weight'] / OPTIMA) ** 2


def test_a_trial_that_is_left_out_has_no_say() -> None:
    search = CrossValidation({'weight': 1.0}, errors_of)
    assert search.best(np.array([True, True, True, False])) == {'weight': 0.02}
    assert search.best(np.array([False, False, False, True])) == {'weight': 5.0}


@pytest.mark.parametrize('step', range(-9, 9))
def test_steps_and_values_are_each_other(step: int) -> None:
    assert step_of(value_of(step)) == step
