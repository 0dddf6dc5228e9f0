# SPDX-License-Identifier: Apache-2.0
"""The noise floor is what noise really leaves on held-out parts, in each campaign's own draw."""

from collections.abc import Iterator

import numpy as np
import pytest
from thermal_comp.comparison.held_out import hold_out
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.turn_on_bias import TurnOnBias
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise
from thermal_comp.noise.of_model import noise_of_model

from ..campaign import PERIOD, WHITE, coloured, run

SENSOR = 'gyroscope'
DENSITY = WHITE['angular_velocity']
LINE = (BiasTemperature(),)
TRUE_NOISE = NoiseModel(
    white=np.full(3, DENSITY),
    time_constants=np.array([200.0, 4000.0]),
    amplitudes=np.full((2, 3), 0.4 * DENSITY),
)
"""Of what `coloured` draws sample by sample."""
SETTLING = 4000
"""Samples after which a draw is independent of its start."""


@pytest.fixture(scope='module')
def runs() -> list[PreparedRun]:
    return prepare([run(up, seed=k, cycles=3) for k, up in enumerate(('+x', '+y'))])


def draws(runs: list[PreparedRun], count: int) -> Iterator[list[PreparedRun]]:
    """The same runs with new noise on a line in temperature; what depends on them is kept."""
    rng = np.random.default_rng(11)
    for _ in range(count):
        for one in runs:
            n = len(one.conditions.time)
            noise = DENSITY * coloured((n + SETTLING, 3), rng, PERIOD)[SETTLING:]
            line = 1e-4 * one.temperature[:, None] * np.array([1.0, 2.0, -1.0])
            one.measured[SENSOR][:] = one.block_mean(noise) + line
        yield runs


def errors(runs: list[PreparedRun], noise: NoiseModel) -> tuple[float, float]:
    """Mean square held-out error over the axes, and the floor's."""
    held = hold_out(runs, {SENSOR: LINE}, {SENSOR: noise})
    return float((held.rms(SENSOR) ** 2).mean()), float((held.floor(SENSOR) ** 2).mean())


@pytest.mark.long
def test_floor_of_the_true_noise_is_the_mean_square_of_what_is_left(runs) -> None:
    left = np.array([errors(drawn, TRUE_NOISE) for drawn in draws(runs, 64)])
    error, floor = left.mean(axis=0)
    standard_error = left[:, 0].std() / np.sqrt(len(left))
    assert standard_error < 0.02 * floor
    assert abs(error / floor - 1.0) < 0.02


@pytest.mark.long
def test_floor_of_the_fitted_noise_follows_each_draw(runs) -> None:
    ratios = []
    for drawn in draws(runs, 24):
        extrapolated = fit_noise(drawn, SENSOR)
        fitted = noise_of_model(drawn, SENSOR, LINE, extrapolated)
        pairs = [errors(drawn, noise) for noise in (extrapolated, fitted)]
        ratios.append([np.sqrt(error / floor) for error, floor in pairs])
    before, after = np.array(ratios).T
    assert abs(after.mean() - 1.0) < 0.02
    assert after.std() < 0.6 * before.std()
    assert (after <= 1.05).mean() >= 0.9


def test_what_jumps_between_cycles_does_not_raise_the_floor(runs) -> None:
    (drawn,) = draws(runs, 1)
    quiet = fit_noise(drawn, SENSOR)
    rng = np.random.default_rng(3)
    for one in drawn:
        one.measured[SENSOR][:] += 3.0 * DENSITY * rng.standard_normal((4, 3))[one.cycle]
    extrapolated = fit_noise(drawn, SENSOR)
    assert noise_of_model(drawn, SENSOR, LINE, extrapolated) is extrapolated
    error, floor = errors(drawn, extrapolated)
    assert error > 4.0 * floor
    named = noise_of_model(drawn, SENSOR, (*LINE, TurnOnBias(3.0, 1.0)), extrapolated)
    np.testing.assert_allclose(
        named.variance_of_means(2000.0), quiet.variance_of_means(2000.0), rtol=0.5
    )


def test_too_short_runs_keep_the_noise_they_are_given() -> None:
    short = prepare([run(cycles=1)])
    short[0].measured[SENSOR][25:] = np.nan
    assert noise_of_model(short, SENSOR, LINE, TRUE_NOISE) is TRUE_NOISE
