# SPDX-License-Identifier: Apache-2.0
"""A model that errs more on held-out cycles than a line, or than none, is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.comparison.simpler import worse_than_simpler
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared

from ..campaign import chamber, measured_by, run

LINE = (EFFECTS['bias_temperature'](),)
BENT = (*LINE, EFFECTS['bias_temperature_curvature']())


def worse(effects: tuple[Effect, ...], course: np.ndarray) -> tuple[str, ...]:
    """Return what is said of a gyroscope whose x axis has a further error (n,)."""
    error = course[:, None] * np.array([1.0, 0.0, 0.0])
    runs = prepare(measured_by([run(error={'angular_velocity': error})], 'gyroscope'))
    model = fit_prepared({'gyroscope': effects}, runs)
    return worse_than_simpler(model, compare_prepared(model, runs), runs)


def test_a_bend_that_every_cycle_repeats_beats_a_line() -> None:
    _, die, *_ = chamber()
    assert worse(BENT, 1e-3 * ((die - 20.0) / 30.0) ** 2) == ()


def test_a_slope_that_changes_its_sign_from_cycle_to_cycle_is_worse_than_none() -> None:
    _, die, _, cycle = chamber()
    sign = np.where(cycle % 2 == 0, 1.0, -1.0)
    said = worse(LINE, 1e-3 * sign * (die - 20.0))
    assert len(said) == 1
    assert said[0].startswith('gyroscope x: the error on held-out parts is ')
    assert said[0].endswith(' times that of no model at all')


def test_a_model_that_leaves_more_than_was_measured_is_worse_than_none() -> None:
    _, die, *_ = chamber()
    error = 1e-3 * (die - 20.0)[:, None] * np.array([1.0, 0.0, 0.0])
    runs = prepare(measured_by([run(error={'angular_velocity': error})], 'gyroscope'))
    model = fit_prepared({'gyroscope': LINE}, runs)
    part = model.sensors['gyroscope']
    wrong = replace(part, coefficients=(-3.0 * part.coefficients[0],))
    other = replace(model, sensors={'gyroscope': wrong})
    compared = compare_prepared(other, runs)
    assert compared.sensors['gyroscope'].held_out_rms == pytest.approx(
        compare_prepared(model, runs).sensors['gyroscope'].held_out_rms
    )
    said = worse_than_simpler(other, compared, runs)
    assert 'gyroscope x: the error is 4.00 times that of no model at all' in said


def test_what_is_nothing_has_nothing_simpler() -> None:
    _, die, *_ = chamber()
    assert worse((), np.zeros(len(die))) == ()
