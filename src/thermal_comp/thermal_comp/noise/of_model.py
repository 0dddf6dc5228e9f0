# SPDX-License-Identifier: Apache-2.0
"""The noise beside a model, with the slow noise that these runs really had.

A saturated model follows drifts over cycles and hours as well, so that a bias that creeps is not
taken for noise. It follows the slow noise of these runs, too, whose size is then extrapolated from
faster noise, wrong by some 10 % of its standard deviation; but the error of a held-out part is
mostly slow noise. Where a model leaves no more over cycles and hours than noise may, the noise is
fitted to what it leaves there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.covariance import block_variances, expected_square
from thermal_comp.noise.estimation import saturated_model
from thermal_comp.noise.process import ResidualSpectrum
from thermal_comp.noise.projection import LEAST_BLOCKS, not_followed, projection_of
from thermal_comp.noise.saturated_model import SaturatedModel
from thermal_comp.noise.vibration import VibrationNoise
from thermal_comp.noise.whittle import fit_noise_to_spectra

MOST_SPREAD_RATIO = 1.15
"""Rms about a run's mean, over that of the extrapolated noise, above which more than noise is left
over cycles and hours: an effect that is not in the model. Chance reaches 1.11 once in a hundred
campaigns."""


@kept
def noise_of_model(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    effects: Sequence[Effect],
    extrapolated: NoiseModel,
) -> NoiseModel:
    """Return the noise that a model of these effects leaves in the runs.

    Everything repeatable and the columns of `effects` are taken out, cycles and hours are not.
    `extrapolated`, the noise behind a saturated model, is returned where more than noise is left.
    """
    vibration = VibrationNoise.of_model(extrapolated, runs[0].period)
    repeatable = replace(saturated_model(runs, sensor), over_time=False)
    spectra = [
        _spectrum(run, sensor, repeatable, tuple(effects), vibration, extrapolated.time_constants)
        for run in runs
    ]
    if any(spectrum is None for spectrum in spectra):
        return extrapolated
    factors = extrapolated.white_factors
    scaled = [
        spectrum.with_white(factors.get(run.name, 1.0))
        for run, spectrum in zip(runs, spectra, strict=True)
        if spectrum is not None
    ]
    found = replace(
        fit_noise_to_spectra(scaled, vibration),
        white_factors=factors,
        white_weights=extrapolated.white_weights,
    )
    more = _spread(runs, found) / np.maximum(_spread(runs, extrapolated), 1e-300)
    return found if more <= MOST_SPREAD_RATIO**2 else extrapolated


def _spread(runs: Sequence[PreparedRun], noise: NoiseModel) -> float:
    """Return the expected mean square about the mean of each run, summed over the axes."""
    total = 0.0
    for run in runs:
        level = np.full((len(run), 1), 1.0 / np.sqrt(len(run)))
        variance = block_variances(noise, run).mean(axis=0)
        for axis in range(3):
            share = expected_square(noise, run, axis, level) / len(run)
            total += float(variance[axis]) - share
    return total


def _spectrum(
    run: PreparedRun,
    sensor: Sensor,
    repeatable: SaturatedModel,
    effects: tuple[Effect, ...],
    vibration: VibrationNoise,
    time_constants: FloatArray,
) -> ResidualSpectrum | None:
    values = run.measured[sensor]
    valid = run.valid(sensor)
    if valid.sum() < LEAST_BLOCKS:
        return None
    beside = not_followed([run], sensor, effects, repeatable)
    further = {(sensor, effect): run.columns(effect, sensor) for effect in beside}
    shaking = vibration.shaking(run, valid)
    projection = projection_of(run, valid, repeatable, further, shaking, time_constants)
    return projection.spectrum_of(values[valid])
