# SPDX-License-Identifier: Apache-2.0
"""Fit white noise plus a ladder of Ornstein-Uhlenbeck processes to what a saturated model leaves.

Whittle likelihood of the periodogram with its exact expectation. The ladder's amplitudes are held
together by a smoothness prior, so that processes slower than a campaign follow the trend of the
faster ones, as flicker noise does.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.conditions import Sensor
from thermal_comp.model import NoiseModel
from thermal_comp.noise_process import LADDER, mean_autocovariance, toeplitz_product
from thermal_comp.noise_spectrum import Projection, ResidualSpectrum, project_spectra
from thermal_comp.prepared_run import PreparedRun
from thermal_comp.saturated_model import saturated_basis

SMOOTHNESS = 1.2
"""Standard deviation of the log-variance step between neighbours of the ladder."""

FLOOR = 1e-9
"""Least variance of a process, as a share of the residual's."""


def fit_noise(runs: Sequence[PreparedRun], sensor: Sensor) -> NoiseModel:
    """Return the noise of one sensor: white and coloured part per axis.

    It is a property of the measurement, not of a model: every effect a saturated model can
    follow is taken out first.
    """
    return fit_noise_to_values(runs, [run.measured[sensor] for run in runs])


def fit_noise_to_values(runs: Sequence[PreparedRun], values: Sequence[FloatArray]) -> NoiseModel:
    """Return the noise of values (m, 3) per run, measured or drawn under the runs' conditions."""
    spectra = [_spectrum_of(run, v) for run, v in zip(runs, values, strict=True)]
    return fit_noise_to_spectra([s for s in spectra if s is not None])


def fit_noise_to_spectra(spectra: Sequence[ResidualSpectrum]) -> NoiseModel:
    """Return the noise model whose expected spectra fit best, per axis."""
    if not spectra:
        return NoiseModel(np.zeros(3), LADDER, np.zeros((len(LADDER), 3)))
    expected = np.concatenate([s.expected for s in spectra], axis=1)
    periodogram = np.concatenate([s.periodogram for s in spectra])
    weight = np.concatenate([s.weight for s in spectra])
    scale = np.maximum((periodogram * weight[:, None]).sum(axis=0), 1e-300) / np.maximum(
        (expected[0] * weight).sum(), 1e-300
    )
    common = np.log(_whittle((periodogram / scale).mean(axis=1), expected, weight * 3.0))
    variances = np.stack(
        [_whittle(p, expected, weight, prior=common) for p in (periodogram / scale).T], axis=1
    )
    return NoiseModel(
        white=np.sqrt(variances[0] * scale),
        time_constants=LADDER,
        amplitudes=np.sqrt(variances[1:] * scale),
    )


def expected_square(noise: NoiseModel, run: PreparedRun, axis: int, operator: FloatArray) -> float:
    """Return E|operatorᵀ·noise|² summed over the operator's columns (m, q) [unit²]."""
    covariance = mean_autocovariance(noise, axis, run.period, int(run.slot[-1]) + 1)
    product = toeplitz_product(covariance, run.slot, operator)
    return float(np.einsum('mq,mq->', operator, product))


_PROJECTIONS: WeakKeyDictionary[PreparedRun, dict[bytes, Projection]] = WeakKeyDictionary()
"""Projections of runs by the rows that are valid: mostly the same for all sensors."""


def _spectrum_of(run: PreparedRun, values: FloatArray) -> ResidualSpectrum | None:
    valid = np.isfinite(values).all(axis=1)
    if valid.sum() < 30:
        return None
    kept = _PROJECTIONS.setdefault(run, {})
    if valid.tobytes() not in kept:
        basis = saturated_basis(run)
        if not valid.all():
            basis, _ = np.linalg.qr(basis[valid])
        slot = run.slot[valid] - run.slot[valid][0]
        kept[valid.tobytes()] = project_spectra(slot, basis, LADDER, run.period)
    return kept[valid.tobytes()].spectrum_of(values[valid])


def _whittle(
    periodogram: FloatArray,
    expected: FloatArray,
    weight: FloatArray,
    prior: FloatArray | None = None,
) -> FloatArray:
    """Return the variances (k + 1,) that maximise Σ w (−I/m − ln m) plus the prior's log."""
    order = len(expected)
    precision = _smoothness_precision(order)
    centre = np.zeros(order)
    if prior is not None:
        precision = precision + np.diag(np.r_[0.0, np.full(order - 1, 1.0 / 0.7**2)])
        centre = prior
    log_variance = np.full(order, -1.0) if prior is None else prior.copy()
    log_variance[0] = min(log_variance[0], 0.0)
    damping = 1e-2
    value = _objective(log_variance, periodogram, expected, weight, precision, centre)
    for _ in range(100):
        share = np.exp(log_variance)[:, None] * expected
        spectrum = np.maximum(share.sum(axis=0), 1e-300)
        share = share / spectrum
        gradient = share @ (weight * (1.0 - periodogram / spectrum))
        gradient += precision @ (log_variance - centre)
        curvature = (share * weight) @ share.T + precision
        step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)), gradient)
        trial = np.clip(log_variance - np.clip(step, -2.0, 2.0), np.log(FLOOR), 25.0)
        new = _objective(trial, periodogram, expected, weight, precision, centre)
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
    expected: FloatArray,
    weight: FloatArray,
    precision: FloatArray,
    centre: FloatArray,
) -> float:
    spectrum = np.maximum(np.exp(log_variance) @ expected, 1e-300)
    away = log_variance - centre
    return float(
        weight @ (periodogram / spectrum + np.log(spectrum)) + 0.5 * away @ precision @ away
    )


def _smoothness_precision(order: int) -> FloatArray:
    """Precision of the steps between neighbours of the ladder; white noise stands free."""
    steps = np.diff(np.eye(order)[1:], axis=0)
    return np.asarray(steps.T @ steps) / SMOOTHNESS**2 + 1e-6 * np.eye(order)
