# SPDX-License-Identifier: Apache-2.0
"""Vibration adds noise to some rows: they weigh less, and still rows keep their noise."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.linear.whitening import RowWhitening, apply_gains, innovation_gains
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.covariance import noise_product
from thermal_comp.noise.estimation import fit_noise
from thermal_comp.noise.of_runs import determined_noise, independent_axes, turned_runs
from thermal_comp.noise.process import (
    OU_TIME_CONSTANTS,
    Shaking,
    draw_noise,
    mean_autocovariance,
    project_spectra,
)
from thermal_comp.noise.saturated_model import SaturatedModel
from thermal_comp.noise.vibration import noise_of_vibration

from ..campaign import PERIOD, WHITE, chamber, measured_by, run

SENSOR = 'accelerometer'
STILL, SHAKEN = 1e-4, 1.0
"""Variances of the acceleration [(m/s²)²]."""
DENSITY = 400.0 * WHITE['linear_acceleration'] ** 2
"""White variance of a one-second mean per unit of vibration: twenty times the noise."""
DIRECTION = np.array([1.0, -0.7, 0.5])


def compressor() -> np.ndarray:
    """Whether it runs: for seven minutes in twenty."""
    return chamber()[0] % 1200.0 < 420.0


@cache
def shaken(seed: int = 0, size: float = 1.0) -> ImuRecording:
    """A device that a compressor shakes along one direction; the vibration was logged."""
    rng = np.random.default_rng([seed, 7])
    time, on = chamber()[0], compressor()
    level = np.where(on, SHAKEN * rng.uniform(0.5, 1.5, len(time)), STILL)
    excess = np.where(on, level, 0.0)
    shaking = np.sqrt(size * DENSITY * excess / PERIOD) * rng.standard_normal(len(time))
    error = {'linear_acceleration': np.outer(shaking, DIRECTION)}
    vibration = np.outer(level, DIRECTION**2 / (DIRECTION**2).sum())
    return replace(run('+z', seed=seed, error=error), vibration=vibration)


@cache
def prepared(size: float = 1.0) -> list[PreparedRun]:
    return prepare([shaken(size=size)])


def test_the_growth_is_found_from_differences_of_neighbours_alone() -> None:
    found = noise_of_vibration(prepared(), SENSOR, SaturatedModel(), [{}])
    along = DENSITY * DIRECTION**2
    assert found.density == pytest.approx(along, rel=0.35)
    still = noise_of_vibration(prepared(size=0.0), SENSOR, SaturatedModel(), [{}])
    assert not still.density.any()
    assert still.shaking(prepared()[0], np.ones(len(prepared()[0]), bool)) is None


def test_the_noise_of_still_rows_and_what_vibration_adds_are_found() -> None:
    noise = fit_noise(prepared(), SENSOR)
    assert noise.white == pytest.approx(WHITE['linear_acceleration'], rel=0.15)
    assert np.sqrt(noise.per_vibration / DENSITY) == pytest.approx(np.abs(DIRECTION), rel=0.15)
    assert not fit_noise(prepared(), 'gyroscope').per_vibration.any()


def test_vibration_that_adds_no_noise_leaves_it_as_it_was() -> None:
    noise = fit_noise(prepared(0.0), SENSOR)
    assert not noise.per_vibration.any()
    without = prepare([replace(shaken(size=0.0), vibration=None)])
    assert noise.white == pytest.approx(fit_noise(without, SENSOR).white, rel=0.02)


def test_a_step_while_it_is_shaken_is_no_noise_of_vibration() -> None:
    time, on = chamber()[0], compressor()
    begins = time[on][len(time[on]) // 2]
    step = np.outer(time >= begins, 200.0 * WHITE['linear_acceleration'] * DIRECTION)
    knocked = replace(
        shaken(size=0.0), linear_acceleration=shaken(size=0.0).linear_acceleration + step
    )
    runs = prepare([knocked])
    noise = fit_noise(runs, SENSOR)
    assert not noise.per_vibration.any()
    assert noise.white == pytest.approx(fit_noise(prepared(0.0), SENSOR).white, rel=0.05)
    assert independent_axes(runs, SENSOR) is None


def test_noise_is_independent_along_the_axes_that_are_found_still_and_shaken() -> None:
    runs = prepared()
    axes = independent_axes(runs, SENSOR)
    assert axes is not None
    turned = turned_runs(runs, SENSOR, axes)
    noise = fit_noise(turned, SENSOR)
    along = np.abs(axes.T @ DIRECTION)
    added = noise.added_by(turned[0].vibration, turned[0].period).max(axis=0)
    assert np.argmax(along) == np.argmax(added)
    assert np.sort(added)[1] < 1e-3 * added.max()
    assert np.sort(along)[1] < 0.05 * along.max()


@pytest.mark.long
def test_bursts_of_one_block_tell_the_axes_of_their_noise_as_well() -> None:
    wanted = independent_axes(prepared(), SENSOR)
    found = independent_axes([replace(r, slot=30 * r.slot) for r in prepared()], SENSOR)
    assert wanted is not None
    assert found is not None
    assert np.abs(found.T @ DIRECTION) == pytest.approx(np.abs(wanted.T @ DIRECTION), abs=0.05)


def test_a_narrow_band_shake_leaves_the_few_still_rows_their_noise() -> None:
    rng = np.random.default_rng(5)
    plain, (blocks,) = shaken(size=0.0), prepared(0.0)
    excess = rng.uniform(0.5, 1.5, len(blocks)) * (rng.random(len(blocks)) > 0.1)
    ends = rng.standard_normal(len(blocks) + 1)  # a block takes back what the last one had
    shake = np.sqrt(0.02 * DENSITY * excess / blocks.period) * np.diff(ends)
    shake, excess = (np.repeat(x, len(plain) // len(blocks)) for x in (shake, excess))
    shaking = replace(
        plain,
        linear_acceleration=plain.linear_acceleration + np.outer(shake, DIRECTION),
        vibration=np.outer(STILL + excess, DIRECTION**2 / (DIRECTION**2).sum()),
    )
    noise = fit_noise(prepare([shaking]), SENSOR)
    assert noise.white == pytest.approx(WHITE['linear_acceleration'], rel=0.3)
    assert noise.per_vibration.all()


@pytest.mark.long
def test_what_was_shaken_along_one_direction_is_no_effect() -> None:
    for seed in range(3):
        diagnosis = diagnose(measured_by([shaken(seed)], SENSOR))
        assert [f.name or f.kind for f in diagnosis.findings if f.sensor == SENSOR] == []
        (note,) = [n for n in diagnosis.notes if 'vibration' in n]
        assert note.startswith('accelerometer: its noise grows with vibration, up to')


def test_a_note_says_how_many_blocks_count_less() -> None:
    noise, notes = determined_noise(prepared(), {SENSOR: (), 'gyroscope': ()})
    (note,) = notes
    factor = np.sqrt(
        1.0
        + noise[SENSOR].added_by(prepared()[0].vibration, prepared()[0].period)
        / noise[SENSOR].variance_of_means(prepared()[0].period)
    ).max(axis=1)
    assert f'{(factor > 2.0).sum()} of {len(factor)} blocks' in note
    assert f'up to {factor.max():.3g} times' in note


NOISE = NoiseModel(
    np.array([1.0, 2.0, 0.5]),
    OU_TIME_CONSTANTS,
    np.outer(np.full(len(OU_TIME_CONSTANTS), 0.1), [1.0, 2.0, 0.5]),
    per_vibration=np.array([30.0, 0.0, 5.0]),
    still_vibration=0.1,
)


def vibrating(rng: np.random.Generator, rows: int) -> np.ndarray:
    return np.where(rng.random(rows) < 0.4, rng.uniform(1.0, 5.0, rows), 0.1)


def test_whitening_counts_what_vibration_adds() -> None:
    rng = np.random.default_rng(1)
    slot = np.r_[0:60, 80:200]
    vibration = vibrating(rng, len(slot))
    dense = mean_autocovariance(NOISE, 0, 20.0, 200)[np.abs(slot[:, None] - slot)]
    dense = dense + np.diag(30.0 * (vibration - 0.1) / 20.0)
    rows = apply_gains(np.eye(len(slot)), innovation_gains(slot, NOISE, 0, 20.0, vibration))
    np.testing.assert_allclose(rows @ dense @ rows.T, np.eye(len(slot)), atol=1e-9)
    whitening = RowWhitening([slot, slot], [NOISE, NOISE], [20.0, 20.0], [vibration, None])
    found = whitening.whitened(np.eye(2 * len(slot))[:, None].repeat(3, axis=1))
    np.testing.assert_array_equal(found[0, : len(slot), : len(slot)], rows)
    still = apply_gains(np.eye(len(slot)), innovation_gains(slot, NOISE, 0, 20.0))
    np.testing.assert_array_equal(found[0, len(slot) :, len(slot) :], still)


def test_products_with_the_covariance_count_it_alike() -> None:
    (one,) = prepared()
    noise = replace(NOISE, still_vibration=STILL)
    unit = np.eye(len(one))[:, [0, 100]]
    plain = noise_product(replace(noise, per_vibration=np.zeros(3)), one, 0, unit)
    extra = (noise_product(noise, one, 0, unit) - plain)[[0, 100], [0, 1]]
    np.testing.assert_allclose(
        extra, 30.0 * (one.vibration[[0, 100]] - STILL) / one.period, atol=1e-9
    )


def test_the_expected_spectrum_of_weighted_rows_is_what_draws_average_to() -> None:
    rng = np.random.default_rng(2)
    slot = np.r_[0:90, 110:200]
    vibration = vibrating(rng, len(slot)) - 0.1
    weights = 1.0 / np.sqrt(1.0 + 20.0 * vibration)
    basis, _ = np.linalg.qr(weights[:, None] * np.stack([np.ones(len(slot)), slot], axis=1))
    shaking = Shaking(weights, vibration / 20.0)
    projection = project_spectra(slot, basis, OU_TIME_CONSTANTS, 20.0, shaking)
    added = np.sqrt(30.0 * vibration / 20.0)
    periodograms = []
    for _ in range(400):
        drawn = draw_noise(NOISE, slot, 20.0, rng)[:, :1]
        drawn += (added * rng.standard_normal(len(slot)))[:, None]
        periodograms.append(projection.spectrum_of(drawn).periodogram[:, 0])
    variances = np.r_[NOISE.white[0] ** 2, NOISE.amplitudes[:, 0] ** 2]
    expected = variances @ projection.expected + 30.0 * projection.shaken
    ratio = (np.mean(periodograms, axis=0) / expected)[projection.weight > 0.2]
    assert abs(ratio.mean() - 1.0) < 0.03
    assert np.all(np.abs(ratio - 1.0) < 0.3)
