# SPDX-License-Identifier: Apache-2.0
"""What equations lack: nothing where they hold, much where a time constant is none."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.flaws import (
    FittedSet,
    FlexibleFunction,
    exact_weight,
    flaws,
    free_flaw,
    gain_of,
    log_prior_at,
    may_be_flawed,
    thermometer_acts,
)
from thermal_comp.diagnosis.evidence.set_fit import fitted_set
from thermal_comp.diagnosis.sensor_answer import SensorAnswer
from thermal_comp.linear.candidate_design import ColumnGroup
from thermal_comp.linear.gaussian_evidence import conditioned, log_sum

from ...campaign import chamber
from ..one_run import PERIOD, behind, lagging_gyroscope, searched


def flaw_and_exact(answer: SensorAnswer, *names: str) -> tuple[float, float]:
    """Return ln of the weight of a set with a flaw and without one."""
    hypotheses = answer.hypotheses
    some = next(s for s in answer.sets if s.names == names)
    state = hypotheses.conditioned(some.components)
    one = FittedSet(some, state, free_flaw(hypotheses, some, state), -np.inf, frozenset())
    return flaws(hypotheses, [one])[0], exact_weight(hypotheses, some)


def test_noise_makes_no_flaw_of_an_equation_that_holds() -> None:
    flaw, exact = flaw_and_exact(lagging_gyroscope(), 'thermal_lag')
    assert abs(flaw - exact) < 3.0


def test_a_lag_that_is_shorter_in_the_cold_is_a_flaw_of_the_equation() -> None:
    warm = (behind(300.0) - behind(600.0)) * np.linspace(0.0, 1.0, len(behind(300.0)))
    flaw, exact = flaw_and_exact(searched(2e-3 * (behind(600.0) + warm)), 'thermal_lag')
    assert flaw > exact + 20.0


def test_the_flaw_of_a_thermometer_is_no_flaw_of_a_small_effect_beside_it() -> None:
    """What follows time alone is none of a thermometer, however much its errors explain."""
    time, *_ = chamber(1, PERIOD)
    wave = 1e-3 * np.sin(2.0 * np.pi * time / time[-1]) ** 3
    answer = searched(2e-3 * (behind(1e9) + behind(20.0)) + wave)
    assert thermometer_acts(answer.hypotheses)
    assert flaw_and_exact(answer, 'warm_up')[0] < flaw_and_exact(answer)[0] + 1.0
    assert answer.likeliest.names == ('not_in_catalogue',)


def test_where_nothing_is_explained_no_equation_can_be_wrong() -> None:
    quiet = searched(np.zeros(len(behind(300.0))))
    nothing = next(s for s in quiet.sets if not s.names)
    assert not may_be_flawed(quiet.hypotheses, nothing)
    assert exact_weight(quiet.hypotheses, nothing) == 0.0


def test_what_stands_already_adds_nothing_and_what_lacks_has_its_size() -> None:
    answer = lagging_gyroscope()
    lag = next(s for s in answer.sets if s.names == ('thermal_lag',))
    (term,), flat = lag.components[0].form.terms, priors.amplitude_log_prior(None)
    nothing = answer.hypotheses.conditioned(())
    explained = answer.hypotheses.explained(lag.components, ())
    gain, amplitude = gain_of(nothing, FlexibleFunction(term, flat))
    assert gain == pytest.approx(0.5 * explained, rel=0.5)
    assert 0.4 < amplitude / np.sqrt(explained / 3.0) < 2.5  # of one axis, steps of two
    assert (
        gain_of(
            answer.hypotheses.conditioned(lag.components),
            FlexibleFunction(term, flat, beside=False),
        )[0]
        < 1.0
    )


def test_what_explains_more_than_a_flaw_may_does_not_count() -> None:
    answer = lagging_gyroscope()
    lag = next(s for s in answer.sets if s.names == ('thermal_lag',))
    (term,), flat = lag.components[0].form.terms, priors.amplitude_log_prior(None)
    nothing = answer.hypotheses.conditioned(())
    size = float(np.sqrt(answer.hypotheses.explained(lag.components, ())))
    free = gain_of(nothing, FlexibleFunction(term, flat))[0]
    assert gain_of(nothing, FlexibleFunction(term, flat, 2.0 * size))[0] == pytest.approx(free)
    assert gain_of(nothing, FlexibleFunction(term, flat, 0.3 * size))[0] < 0.8 * free


def test_another_effect_is_no_flaw_of_one_that_explains_nothing() -> None:
    """However well the two together explain what is left."""
    answer = lagging_gyroscope()
    hypotheses = answer.hypotheses
    lag, settling = (
        next(c for s in answer.sets for c in s.components if c.name == name)
        for name in ('thermal_lag', 'warm_up')
    )
    sets = [fitted_set(hypotheses, each) for each in ((settling,), (lag, settling))]
    assert sets[0].explained < 0.1 * sets[1].explained
    assert sets[1].log_posterior > sets[0].log_posterior + 20.0
    states = [hypotheses.conditioned(some.components) for some in sets]
    fitted = [
        FittedSet(some, state, free_flaw(hypotheses, some, state), -np.inf, frozenset())
        for some, state in zip(sets, states, strict=True)
    ]
    assert flaws(hypotheses, fitted)[0] < 2.0


def test_no_flaw_of_a_lag_looks_like_a_warm_up() -> None:
    """Its law is one of the temperature, however much larger what it explains may be."""
    time, *_ = chamber(1, PERIOD)
    answer = searched(1e-3 * behind(600.0) + 2e-3 * np.exp(-time / 1500.0))
    assert answer.likeliest.names == ('thermal_lag', 'warm_up')
    assert answer.explanations[0].probability > 0.9


def test_what_is_proportional_to_a_channel_has_no_flaw_like_a_step() -> None:
    time, *_ = chamber(1, PERIOD)
    supply = 3.3 + 0.05 * np.sin(time / 900.0) ** 3
    step = 2e-4 * (time > 0.6 * time[-1])
    names = ('bias_step', 'supply_sensitivity')
    answer = searched(0.1 * (supply - 3.3) + step, names, supply)
    assert answer.explanations[0].names == names
    assert answer.probability_of('bias_step') > 0.95


def test_a_prior_is_interpolated_and_held_at_its_ends() -> None:
    known = -np.arange(len(priors.AMPLITUDES), dtype=float)
    between = float(np.sqrt(priors.AMPLITUDES[3] * priors.AMPLITUDES[4]))
    sizes = (0.0, 1.0, priors.AMPLITUDES[3], between, 1e9)
    assert [log_prior_at(s, known) for s in sizes] == pytest.approx([0.0, 0.0, -3.0, -3.5, -12.0])


def test_the_evidence_of_a_function_of_many_coefficients_is_that_of_a_dense_grid() -> None:
    rng = np.random.default_rng(8)
    rows, width = 2000, 150
    columns = rng.standard_normal((3, rows, width)) / np.sqrt(rows)
    for size in (5.0, 8.0, 11.0):
        target = rng.standard_normal((3, rows)) + columns @ (size * rng.standard_normal(width))
        normal = columns.transpose(0, 2, 1) @ columns
        right = np.einsum('anp,an->ap', columns, target)
        state = conditioned(normal, right, float((target**2).sum()), 3 * rows, [])
        even = np.full(len(priors.AMPLITUDES), -np.log(len(priors.AMPLITUDES)))
        dense = np.geomspace(priors.AMPLITUDES[0], priors.AMPLITUDES[-1], 2401)
        each = state.evidences(np.arange(width)[None], dense, shared=False)[0][0]
        expected = log_sum(each - state.log_evidence + even[0] - np.log(200.0))
        gain, best = gain_of(
            state, FlexibleFunction(ColumnGroup(tuple(range(width))), even, beside=False)
        )
        assert gain == pytest.approx(expected, abs=2.0)
        assert best == pytest.approx(dense[int(np.argmax(each))], rel=0.2)
