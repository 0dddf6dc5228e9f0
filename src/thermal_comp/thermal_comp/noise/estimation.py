# SPDX-License-Identifier: Apache-2.0
"""White noise and Ornstein-Uhlenbeck processes, fitted to what a saturated model leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray
from scipy.linalg import pinvh
from scipy.special import chdtrc

from thermal_comp.data.acting_channels import ACTING_CHANNELS
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.time_scale import time_scale
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import LEAST_NEW_LENGTH, orthonormal, project_out
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.covariance import noise_product
from thermal_comp.noise.jumps import basis_with_jumps
from thermal_comp.noise.process import ResidualSpectrum, correlation_times, project_spectra
from thermal_comp.noise.projection import (
    LEAST_BLOCKS,
    FurtherColumns,
    basis_of_rows,
    not_followed,
    projection_of,
)
from thermal_comp.noise.saturated_model import SaturatedModel, channel_columns
from thermal_comp.noise.vibration import VibrationNoise, noise_of_vibration
from thermal_comp.noise.whittle import fit_noise_to_spectra

OTHER_NOISE_RATIO, OTHER_NOISE_STDS = 1.5, 5.0
"""Ratio of a run's variance of white noise to that of all, and number of its standard deviations,
from which runs have white noise of their own: other ranges, coarser counts, other rates."""
FACTOR_ROUNDS = 5
"""Rounds in which the factors of runs and the noise they share are fitted in turn."""
CHANNEL_SIGNIFICANCE = 1e-3
"""Probability that a channel which does not act is taken for one that does."""


@kept
def fit_noise(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect] = ()
) -> NoiseModel:
    """Return the noise of one sensor: white and coloured part per axis.

    It is a property of the measurement, not of a model: every effect that a saturated model can
    follow is taken out first, and those of `effects`, which are known to act, that it cannot
    follow well enough (a step, a spectral line, some hysteresis).
    """
    return _noise_beside(runs, sensor, effects, saturated_model(runs, sensor))


@kept
def saturated_model(runs: Sequence[PreparedRun], sensor: Sensor) -> SaturatedModel:
    """Return the saturated model of a sensor, with the channels that act on it.

    Columns of a channel take something of the noise out, and with it the evidence for each effect
    moves: a channel that does not act must not be among them. Under the noise beside all channels
    the most significant joins until none is significant: χ² of what a channel's columns, beside
    those taken before, explain in each run and axis (least squares, whose coefficients have the
    covariance (VᵀV)⁻¹ Vᵀ S V (VᵀV)⁻¹ under noise of covariance S).
    """
    air, scale = ('chamber_temperature',), time_scale(max(float(r.time[-1]) for r in runs))
    logged = [
        channel.field
        for channel in ACTING_CHANNELS
        if any(run.block_conditions.has(channel.field) for run in runs)
    ]
    if not logged:
        return SaturatedModel(air, time_scale=scale)
    noise = _noise_beside(runs, sensor, (), SaturatedModel((*air, *logged), time_scale=scale))
    acting: list[str] = []
    while logged:
        model = SaturatedModel((*air, *acting), time_scale=scale)
        chance = _chances(runs, sensor, noise, model, logged)
        best = int(np.argmin(chance))
        if chance[best] > CHANNEL_SIGNIFICANCE:
            break
        acting.append(logged.pop(best))
    return SaturatedModel((*air, *sorted(acting)), time_scale=scale)


def _chances(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    noise: NoiseModel,
    model: SaturatedModel,
    channels: Sequence[str],
) -> FloatArray:
    """Return the probability that channels which do not act explain as much beside a model."""
    explained, count = np.zeros((2, len(channels)))
    for run in runs:
        valid = run.valid(sensor)
        if valid.sum() < LEAST_BLOCKS:
            continue
        known = basis_of_rows(run, valid, model, {})
        for place, channel in enumerate(channels):
            columns = orthonormal(channel_columns(run, channel)[valid])
            left = project_out(known, columns)
            new = orthonormal(left[:, np.linalg.norm(left, axis=0) > LEAST_NEW_LENGTH])
            for axis in range(3 if new.shape[1] else 0):
                coefficients = new.T @ run.measured[sensor][valid, axis]
                covariance = new.T @ noise_product(noise, run, axis, new, valid)
                explained[place] += coefficients @ pinvh(covariance) @ coefficients
                count[place] += new.shape[1]
    return np.where(count > 0.0, chdtrc(np.maximum(count, 1.0), explained), 1.0)


def _noise_beside(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect], model: SaturatedModel
) -> NoiseModel:
    """Return the noise that a saturated model leaves, and the effects that it cannot follow."""
    beyond = not_followed(runs, sensor, effects, model)
    furthers = [{(sensor, e): run.columns(e, sensor) for e in beyond} for run in runs]
    vibration = noise_of_vibration(runs, sensor, model, furthers)
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    times = correlation_times(longest, model.time_scale)
    spectra = [
        _spectrum(run, sensor, model, further, vibration, times)
        for run, further in zip(runs, furthers, strict=True)
    ]
    named = {
        run.name: spectrum
        for run, spectrum in zip(runs, spectra, strict=True)
        if spectrum is not None
    }
    noise = fit_noise_to_spectra([*named.values()], vibration)
    factors = dict.fromkeys(named, 1.0)
    for _ in range(FACTOR_ROUNDS):
        factors = _white_factors(noise, named, factors)
        if not factors:
            break
        scaled = [spectrum.with_white(factors[name]) for name, spectrum in named.items()]
        noise = replace(fit_noise_to_spectra(scaled, vibration), white_factors=factors)
    return noise


def _white_factors(
    noise: NoiseModel, spectra: Mapping[str, ResidualSpectrum], factors: Mapping[str, float]
) -> dict[str, float]:
    """Return by how much the white noise of each run is larger; {} where all have the same.

    `factors` so far are off by the mean of the periodogram over its expectation, each frequency
    and axis weighted by the share of white noise in it. Slow noise is the sensor's, whatever the
    range or the rate of a run.
    """
    found, differ = dict(factors), any(factor != 1.0 for factor in factors.values())
    for name, one in spectra.items():
        spectrum = one.with_white(factors[name])
        white = np.outer(spectrum.expected[0], noise.white**2)
        expected = white + spectrum.expected[1:].T @ noise.amplitudes**2
        expected = np.maximum(expected + np.outer(spectrum.shaken, noise.per_vibration), 1e-300)
        weight = spectrum.weight[:, None] * white / expected
        rows = max(float(weight.sum()), 1e-300)
        change = float((weight * spectrum.periodogram / expected).sum()) / rows
        away = abs(np.log(max(change, 1e-300)))
        differ |= away > max(np.log(OTHER_NOISE_RATIO), OTHER_NOISE_STDS / np.sqrt(rows))
        found[name] *= float(np.sqrt(change))
    return found if differ and len(found) > 1 and min(found.values()) > 0.0 else {}


def effects_beyond(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect]
) -> tuple[Effect, ...]:
    """Return the effects the saturated model cannot follow in some run."""
    return not_followed(runs, sensor, effects, saturated_model(runs, sensor))


def _spectrum(
    run: PreparedRun,
    sensor: Sensor,
    model: SaturatedModel,
    further: FurtherColumns,
    vibration: VibrationNoise,
    time_constants: FloatArray,
) -> ResidualSpectrum | None:
    """Return the spectrum of a run less the model, `further` columns and jumps.

    None where the run is too short.
    """
    values = run.measured[sensor]
    valid = run.valid(sensor)
    if valid.sum() < LEAST_BLOCKS:
        return None
    values, shaking = values[valid], vibration.shaking(run, valid)
    projection = projection_of(run, valid, model, further, shaking, time_constants)
    weights = np.ones(len(values)) if shaking is None else shaking.weights
    slot, known = projection.slot, projection.basis
    basis = basis_with_jumps(weights[:, None] * values, slot, known, weights)
    if basis is not known:
        projection = project_spectra(slot, basis, time_constants, run.period, shaking)
    return projection.spectrum_of(values)
