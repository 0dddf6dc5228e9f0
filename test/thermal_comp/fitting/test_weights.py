# SPDX-License-Identifier: Apache-2.0
"""A fit weighs with its noise, or without slow noise where that predicts held-out parts better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray
from scipy.linalg import block_diag
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.weights import solved, with_best_weights
from thermal_comp.linear.design import Design
from thermal_comp.noise.covariance import noise_product
from thermal_comp.noise.estimation import fit_noise

from imu_recording import ImuRecording

from ..campaign import SLOPES, WHITE, coloured, measured_by, run

SENSOR = 'gyroscope'
LINE = {SENSOR: (BiasTemperature(),)}
SLOPE = SLOPES['angular_velocity']


def days_out_of_a_fridge(of_cooling: FloatArray, seed: int) -> ImuRecording:
    """An hour into the fridge and a day out of it; `of_cooling` (3,) [rad/s per K/min]."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 86_400.0, 10.0)
    die = np.where(time < 3600.0, 5.0 + 20.0 * np.exp(-time / 600.0), 5.0)
    die += 15.0 * (1.0 - np.exp(-np.maximum(time - 3600.0, 0.0) / 30_000.0))
    rate = 60.0 * np.gradient(die, time)
    return measured_by(
        [
            ImuRecording(
                stamp=np.round(time * 1e9).astype(np.int64),
                temperature=die + 0.01 * rng.standard_normal(len(time)),
                device='board',
                up_axis='+z',
                linear_acceleration=np.full((len(time), 3), np.nan),
                magnetic_field=np.full((len(time), 3), np.nan),
                angular_velocity=(die - 20.0)[:, None] * SLOPE
                + rate[:, None] * of_cooling
                + WHITE['angular_velocity'] * coloured((len(time), 3), rng, 10.0),
            )
        ],
        SENSOR,
    )[0]


def slopes(runs: list[PreparedRun], *, white: bool) -> FloatArray:
    """Return the (3,) slopes, in true ones, that a line has with given weights."""
    noise = replace(fit_noise(runs, SENSOR, LINE[SENSOR]), white_weights=(white,) * 3)
    design = Design([run.smoothed for run in runs], LINE, {SENSOR: noise})
    estimate = solved(design).estimate[:, 0]
    found: FloatArray = estimate[design.terms[0].unknowns] / SLOPE
    return found


def test_an_hour_of_cooling_does_not_set_the_slope_of_the_day_after_it() -> None:
    runs = prepare([days_out_of_a_fridge(np.array([1e-3, 0.0, 0.0]), seed=0)])
    model = fit_prepared(LINE, runs)
    fitted = model.sensors[SENSOR]
    assert any('gyroscope x: fitted without' in note for note in model.provenance.notes)
    assert fitted.noise is not None
    assert fitted.noise.white_weights == (True, False, False)
    assert np.all(np.abs(fitted.coefficients[0][0] / SLOPE - 1.0) < 0.1)
    assert slopes(runs, white=False)[0] < 0.75


def test_where_nothing_is_missing_the_noise_sets_the_weights() -> None:
    for seed in range(4):
        day = prepare([days_out_of_a_fridge(np.zeros(3), seed)])
        cycles = prepare(measured_by([run(seed=seed)], SENSOR))
        for runs in (day, cycles):
            noise = {SENSOR: fit_noise(runs, SENSOR, LINE[SENSOR])}
            assert with_best_weights(runs, LINE, noise)[SENSOR].white_weights == (False,) * 3


def test_the_covariance_is_that_of_the_estimate_under_the_noise() -> None:
    runs = prepare(measured_by([run(cycles=1), run('+x', cycles=1)], SENSOR))
    noise = replace(fit_noise(runs, SENSOR), white_weights=(False, True, False))
    design = Design(runs, LINE, {SENSOR: noise})
    slope = design.terms[0].unknowns
    found = solved(design).covariance[slope, slope]
    by_noise = solved(Design(runs, LINE, {SENSOR: replace(noise, white_weights=(False,) * 3)}))
    for axis in (0, 2):
        assert np.isclose(found[axis, axis], by_noise.covariance[slope, slope][axis, axis])
    columns = [np.column_stack([np.ones(len(r)), r.temperature - 20.0]) for r in runs]
    levels = block_diag(*(c[:, :1] for c in columns))
    every = np.column_stack([levels, np.concatenate([c[:, 1] for c in columns])])
    covariance = block_diag(*(noise_product(noise, r, 1, np.eye(len(r))) for r in runs))
    plain = np.linalg.inv(every.T @ every)
    expected = (plain @ every.T @ covariance @ every @ plain)[-1, -1]
    assert np.isclose(found[1, 1], expected, rtol=1e-6)
    assert found[1, 1] > by_noise.covariance[slope, slope][1, 1]
