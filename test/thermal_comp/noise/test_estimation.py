# SPDX-License-Identifier: Apache-2.0
"""The noise of a simulated draw is found again, and whitening makes it white."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.linear.whitening import apply_gains, innovation_gains
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise, saturated_model
from thermal_comp.noise.of_runs import determined_noise
from thermal_comp.noise.process import (
    OU_TIME_CONSTANTS,
    draw_noise,
    mean_autocovariance,
    project_spectra,
    toeplitz_product,
)
from thermal_comp.noise.whittle import fit_noise_to_spectra

from ..campaign import WHITE, chamber, run

PERIOD = 20.0
TRUE_NOISE = NoiseModel(
    white=np.array([1.0, 2.0, 0.5]),
    time_constants=OU_TIME_CONSTANTS,
    amplitudes=np.outer(np.full(len(OU_TIME_CONSTANTS), 0.1), [1.0, 2.0, 0.5]),
)


def slots_with_gaps(rng: np.random.Generator, length: int = 1500) -> np.ndarray:
    present = rng.random(length) > 0.05
    present[400:460] = False
    present[0] = True
    return np.flatnonzero(present)


def test_whitened_noise_is_white_across_gaps() -> None:
    rng = np.random.default_rng(1)
    slot = slots_with_gaps(rng, 300)
    covariance = mean_autocovariance(TRUE_NOISE, 1, PERIOD, 300)
    dense = covariance[np.abs(slot[:, None] - slot[None, :])]
    rows = apply_gains(np.eye(len(slot)), innovation_gains(slot, TRUE_NOISE, 1, PERIOD))
    np.testing.assert_allclose(rows @ dense @ rows.T, np.eye(len(slot)), atol=1e-9)
    vector = rng.standard_normal((len(slot), 2))
    np.testing.assert_allclose(toeplitz_product(covariance, slot, vector), dense @ vector)


def test_expected_spectrum_is_what_draws_average_to() -> None:
    rng = np.random.default_rng(2)
    slot = slots_with_gaps(rng, 200)
    trend = np.stack([np.ones(len(slot)), slot, slot**2.0], axis=1)
    basis, _ = np.linalg.qr(trend)
    projection = project_spectra(slot, basis, OU_TIME_CONSTANTS, PERIOD)
    spectra = [
        projection.spectrum_of(draw_noise(TRUE_NOISE, slot, PERIOD, rng)) for _ in range(400)
    ]
    measured = np.mean([s.periodogram[:, 0] for s in spectra], axis=0)
    variances = np.r_[TRUE_NOISE.white[0] ** 2, TRUE_NOISE.amplitudes[:, 0] ** 2]
    seen = spectra[0].weight > 0.2
    ratio = (measured / (variances @ spectra[0].expected))[seen]
    assert abs(ratio.mean() - 1.0) < 0.03
    assert np.all(np.abs(ratio - 1.0) < 0.3)


def test_noise_is_found_again_behind_a_projection_and_gaps() -> None:
    rng = np.random.default_rng(3)
    spectra = []
    for _ in range(3):
        slot = slots_with_gaps(rng)
        waves = np.cos(np.pi * np.outer(slot + 0.5, np.arange(40)) / 1500)
        basis, _ = np.linalg.qr(waves)
        drawn = draw_noise(TRUE_NOISE, slot, PERIOD, rng)
        spectra.append(project_spectra(slot, basis, OU_TIME_CONSTANTS, PERIOD).spectrum_of(drawn))
    fitted = fit_noise_to_spectra(spectra)
    np.testing.assert_allclose(fitted.white, TRUE_NOISE.white, rtol=0.05)
    for period, tolerance in ((20.0, 0.25), (200.0, 0.4), (2000.0, 0.6)):
        wanted = TRUE_NOISE.variance_of_means(period)
        np.testing.assert_allclose(fitted.variance_of_means(period), wanted, rtol=tolerance)


def test_noise_of_nothing_is_zero() -> None:
    fitted = fit_noise_to_spectra([])
    assert not fitted.white.any()
    assert not fitted.amplitudes.any()


def test_slow_noise_that_a_short_run_hardly_tells_is_not_taken_for_none() -> None:
    rng = np.random.default_rng(6)
    slot = np.arange(300)
    amplitudes = np.full((len(OU_TIME_CONSTANTS), 3), 0.15)
    true = NoiseModel(np.ones(3), OU_TIME_CONSTANTS, amplitudes)
    waves = np.cos(np.pi * np.arange(40) * (slot[:, None] + 0.5) / len(slot))
    projection = project_spectra(slot, np.linalg.qr(waves)[0], OU_TIME_CONSTANTS, 2.0)
    found = [
        fit_noise_to_spectra([projection.spectrum_of(draw_noise(true, slot, 2.0, rng))])
        for _ in range(40)
    ]
    slow = np.sqrt([(noise.amplitudes**2).sum(axis=0).mean() for noise in found])
    ratio = slow / np.sqrt((amplitudes[:, 0] ** 2).sum())
    assert 0.25 < ratio.min() < 1.0 < ratio.max() < 4.0
    assert 0.7 < np.median(ratio) < 1.5


def test_of_bursts_rows_are_counted_not_the_slots_between_them() -> None:
    rng = np.random.default_rng(8)
    slot = (360 * np.arange(40)[:, None] + np.arange(3)).ravel()
    true = NoiseModel(np.ones(3), OU_TIME_CONSTANTS, np.full((len(OU_TIME_CONSTANTS), 3), 0.25))
    trend = np.stack([np.ones(len(slot)), slot, slot**2.0], axis=1)
    projection = project_spectra(slot, np.linalg.qr(trend)[0], OU_TIME_CONSTANTS, 2.0)
    found = [
        fit_noise_to_spectra([projection.spectrum_of(draw_noise(true, slot, 2.0, rng))])
        for _ in range(20)
    ]
    assert projection.weight.sum() < 0.5 * len(slot) + 1.0
    white = np.array([noise.white for noise in found])
    assert 0.6 < white.min() < white.max() < 1.4


def test_a_run_in_a_coarser_range_has_white_noise_of_its_own() -> None:
    recordings = [run(up, seed=k, cycles=2, period=PERIOD) for k, up in enumerate(('+x', '+y'))]
    values = recordings[1].angular_velocity
    step = np.sqrt(15.0 / PERIOD) * WHITE['angular_velocity']
    coarse = values + step * np.random.default_rng(8).standard_normal(values.shape)
    runs = prepare([recordings[0], replace(recordings[1], angular_velocity=coarse)])
    noise = fit_noise(runs, 'gyroscope')
    fine, loud = (noise.of_run(one.name) for one in runs)
    np.testing.assert_allclose(loud.white / fine.white, 4.0, rtol=0.1)
    np.testing.assert_array_equal(loud.amplitudes, fine.amplitudes)


def test_runs_whose_noise_differs_by_chance_share_it() -> None:
    runs = prepare([run(up, seed=k, cycles=2, period=PERIOD) for k, up in enumerate(('+x', '+y'))])
    assert not fit_noise(runs, 'gyroscope').white_factors


@pytest.mark.long
def test_a_line_in_one_run_alone_is_not_the_noise_of_that_run() -> None:
    time = chamber(3, PERIOD)[0]
    size = 5.0 * WHITE['angular_velocity'] / np.sqrt(PERIOD)
    line = np.outer(np.sin(2.0 * np.pi * time / 487.0), size * np.array([1.0, -0.7, 0.8]))
    runs = prepare([
        run(up, seed=k, cycles=3, period=PERIOD, error={'angular_velocity': line * (k == 1)})
        for k, up in enumerate(('+x', '+y', '+z'))
    ])  # fmt: skip
    base = {'gyroscope': (BiasTemperature(),)}
    noise = determined_noise(runs, base)[0]
    answer = search_sensors(runs, base, noise, Settings(EFFECTS))['gyroscope']
    assert answer.likeliest.names == ('mains_alias',)


def test_slow_noise_of_a_run_with_little_white_noise_is_no_effect() -> None:
    """A run at 50 Hz beside two of single samples, 2 s apart: all have the sensor's flicker."""
    generator, size = np.random.default_rng(3), 4.0 * WHITE['linear_acceleration']
    recordings = [run(up, seed=k, period=PERIOD) for k, up in enumerate(('+x', '+y', '+z'))]
    for k in (1, 2):
        values = recordings[k].linear_acceleration
        added = size / np.sqrt(PERIOD) * generator.standard_normal(values.shape)
        recordings[k] = replace(recordings[k], linear_acceleration=values + added)
    runs = prepare(recordings)
    base = {'accelerometer': (BiasTemperature(),)}
    noise = determined_noise(runs, base)[0]
    answer = search_sensors(runs, base, noise, Settings(EFFECTS))['accelerometer']
    assert answer.likeliest.names == ()
    assert answer.likeliest.probability > 0.5


def test_counts_four_times_as_coarse_in_one_run_are_no_effect() -> None:
    step = 4.0 * WHITE['angular_velocity'] / np.sqrt(PERIOD)
    recordings = [run(up, seed=k, cycles=2, period=PERIOD) for k, up in enumerate(('+x', '+y'))]
    coarse = np.round(recordings[1].angular_velocity / step) * step
    runs = prepare([recordings[0], replace(recordings[1], angular_velocity=coarse)])
    base = {'gyroscope': (BiasTemperature(),)}
    noise = determined_noise(runs, base)[0]
    answer = search_sensors(runs, base, noise, Settings(EFFECTS))['gyroscope']
    assert answer.kind == 'complete'
    assert answer.likeliest.probability > 0.5


def test_only_channels_that_act_are_in_the_saturated_model() -> None:
    time = chamber()[0]
    supply = 3.3 + 0.05 * (time % 7000.0 > 3000.0) + 0.02 * np.sin(2.0 * np.pi * time / 4000.0)
    damp = 40.0 + 5.0 * np.sin(2.0 * np.pi * time / 11_000.0)
    made = 1e-3 * (supply - 3.3)[:, None] * np.array([1.0, -0.5, 0.8])
    plain = run(error={'angular_velocity': made})
    logged = replace(plain, supply_voltage=supply, humidity=damp, fan=np.ones(len(time)))
    runs = prepare([logged])
    assert saturated_model(runs, 'gyroscope').channels == ('chamber_temperature', 'supply_voltage')
    assert saturated_model(runs, 'accelerometer').channels == ('chamber_temperature',)
    alone = fit_noise(prepare([plain]), 'accelerometer')
    np.testing.assert_array_equal(fit_noise(runs, 'accelerometer').white, alone.white)
