# SPDX-License-Identifier: Apache-2.0
"""Fit white noise and Ornstein-Uhlenbeck processes to what a saturated model leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.jumps import basis_with_jumps
from thermal_comp.noise.process import (
    OU_TIME_CONSTANTS,
    ResidualSpectrum,
    mean_autocovariance,
    project_spectra,
    toeplitz_product,
)
from thermal_comp.noise.projection import (
    LEAST_BLOCKS,
    FurtherColumns,
    not_followed,
    projection_of,
)
from thermal_comp.noise.saturated_model import saturated_basis
from thermal_comp.noise.vibration import (
    STEADY,
    VibrationNoise,
    block_variances,
    noise_of_vibration,
)

LOG_VARIANCE_STEP = 1.2
"""Standard deviation of the log-variance step between neighbouring processes."""

TYPICAL_SLOW_SHARE, SLOW_SHARE_LN = 0.2, 1.0
"""Amplitude of each process over the standard deviation of a one-second mean, and standard
deviation of its ln: bias instabilities of MEMS sensors are about a half of it. Without this prior
the most likely variance of slow noise in a short run is often zero, and effects would fit it."""

LEAST_VARIANCE = 1e-9
"""Least variance of a process, as a share of the residual's."""


@kept
def fit_noise(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect] = ()
) -> NoiseModel:
    """Return the noise of one sensor: white and coloured part per axis.

    It is a property of the measurement, not of a model: every effect a saturated model can
    follow is taken out first, and of `effects`, which are known to act, those it cannot follow
    to the last (a step, a spectral line; a hysteresis nearly).
    """
    beyond = effects_beyond(runs, sensor, effects)
    furthers = [{(sensor, e): run.columns(e, sensor) for e in beyond} for run in runs]
    vibration = noise_of_vibration(runs, sensor, furthers)
    spectra = [
        _spectrum(run, sensor, further, vibration)
        for run, further in zip(runs, furthers, strict=True)
    ]
    return fit_noise_to_spectra([s for s in spectra if s is not None], vibration)


def effects_beyond(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect]
) -> tuple[Effect, ...]:
    """Return the effects the saturated model cannot follow in some run."""
    return not_followed(runs, sensor, effects, saturated_basis)


def fit_noise_to_spectra(
    spectra: Sequence[ResidualSpectrum], vibration: VibrationNoise = STEADY
) -> NoiseModel:
    """Return the noise model whose expected spectra fit best, per axis.

    `vibration` is the part of it that is known.
    """
    if not spectra:
        return NoiseModel(np.zeros(3), OU_TIME_CONSTANTS, np.zeros((len(OU_TIME_CONSTANTS), 3)))
    expected = np.concatenate([s.expected for s in spectra], axis=1)
    periodogram = np.concatenate([s.periodogram for s in spectra])
    weight = np.concatenate([s.weight for s in spectra])
    scale = np.maximum((periodogram * weight[:, None]).sum(axis=0), 1e-300) / np.maximum(
        (expected[0] * weight).sum(), 1e-300
    )
    known = np.concatenate([s.shaken for s in spectra])[:, None] * vibration.density / scale
    periodogram = periodogram / scale
    mean = periodogram.mean(axis=1), known.mean(axis=1)
    common = np.log(_whittle(*mean, expected, weight * 3.0))
    variances = np.stack(
        [
            _whittle(*axis, expected, weight, common)
            for axis in zip(periodogram.T, known.T, strict=True)
        ],
        axis=1,
    )
    return NoiseModel(
        white=np.sqrt(variances[0] * scale),
        time_constants=OU_TIME_CONSTANTS,
        amplitudes=np.sqrt(variances[1:] * scale),
        per_vibration=vibration.density,
        still_vibration=vibration.still,
    )


def noise_product(
    noise: NoiseModel,
    run: PreparedRun,
    axis: int,
    values: FloatArray,
    rows: NDArray[np.bool_] | slice = slice(None),
) -> FloatArray:
    """Return S @ values, (m, q), S the covariance of the noise of rows of a run [unit²]."""
    covariance = mean_autocovariance(noise, axis, run.period, int(run.slot[-1]) + 1)
    added = block_variances(noise, run)[rows, axis] - covariance[0]
    product: FloatArray = toeplitz_product(covariance, run.slot[rows], values)
    return product + np.asarray(added)[:, None] * values


def expected_square(noise: NoiseModel, run: PreparedRun, axis: int, operator: FloatArray) -> float:
    """Return E|operatorᵀ·noise|² summed over the operator's columns (m, q) [unit²]."""
    product = noise_product(noise, run, axis, operator)
    return float(np.einsum('mq,mq->', operator, product))


def _spectrum(
    run: PreparedRun, sensor: Sensor, further: FurtherColumns, vibration: VibrationNoise
) -> ResidualSpectrum | None:
    """Return the spectrum of what a saturated model, `further` columns and jumps leave of a run.

    None where the run is too short.
    """
    values = run.measured[sensor]
    valid = np.isfinite(values).all(axis=1)
    if valid.sum() < LEAST_BLOCKS:
        return None
    values, shaking = values[valid], vibration.shaking(run, valid)
    projection = projection_of(run, valid, saturated_basis, further, shaking)
    weights = np.ones(len(values)) if shaking is None else shaking.weights
    slot, known = projection.slot, projection.basis
    basis = basis_with_jumps(weights[:, None] * values, slot, known, weights)
    if basis is not known:
        projection = project_spectra(slot, basis, OU_TIME_CONSTANTS, run.period, shaking)
    return projection.spectrum_of(values)


def _whittle(
    periodogram: FloatArray,
    known: FloatArray,
    expected: FloatArray,
    weight: FloatArray,
    prior: FloatArray | None = None,
) -> FloatArray:
    """Return the variances (k + 1,) that maximise Σ w (−I/m − ln m) plus the prior's log.

    m (f,) = `known` + Σ variance · expected.
    """
    order = len(expected)
    precision = _smoothness_precision(order)
    centre = np.zeros(order)
    if prior is None:
        level = np.r_[-1.0, np.full(order - 1, 1.0 / (order - 1))]
        precision = precision + np.outer(level, level) / (2.0 * SLOW_SHARE_LN) ** 2
        centre[1:] = 2.0 * np.log(TYPICAL_SLOW_SHARE)
    else:
        precision = precision + np.diag(np.r_[0.0, np.full(order - 1, 1.0 / 0.7**2)])
        centre = prior
    log_variance = np.full(order, -1.0) if prior is None else prior.copy()
    log_variance[0] = min(log_variance[0], 0.0)
    damping = 1e-2
    data = periodogram, known, expected, weight
    value = _objective(log_variance, *data, precision, centre)
    for _ in range(100):
        share = np.exp(log_variance)[:, None] * expected
        spectrum = np.maximum(share.sum(axis=0) + known, 1e-300)
        share = share / spectrum
        gradient = share @ (weight * (1.0 - periodogram / spectrum))
        gradient += precision @ (log_variance - centre)
        curvature = (share * weight) @ share.T + precision
        step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), gradient)
        trial = np.clip(log_variance - np.clip(step, -2.0, 2.0), np.log(LEAST_VARIANCE), 25.0)
        new = _objective(trial, *data, precision, centre)
        if new <= value:
            settled = value - new < 1e-7 * max(abs(value), 1.0)
            log_variance, value, damping = trial, new, max(damping * 0.3, 1e-8)
            if settled:
                break
        else:
            damping *= 6.0
            if damping > 1e8:
                break
    return np.exp(log_variance)


def _objective(
    log_variance: FloatArray,
    periodogram: FloatArray,
    known: FloatArray,
    expected: FloatArray,
    weight: FloatArray,
    precision: FloatArray,
    centre: FloatArray,
) -> float:
    spectrum = np.maximum(np.exp(log_variance) @ expected + known, 1e-300)
    away = log_variance - centre
    return float(
        weight @ (periodogram / spectrum + np.log(spectrum)) + 0.5 * away @ precision @ away
    )


def _smoothness_precision(order: int) -> FloatArray:
    """Precision of the steps between neighbouring processes; white noise stands free."""
    steps = np.diff(np.eye(order)[1:], axis=0)
    return np.asarray(steps.T @ steps) / LOG_VARIANCE_STEP**2 + 1e-6 * np.eye(order)
