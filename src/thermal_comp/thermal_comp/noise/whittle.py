# SPDX-License-Identifier: Apache-2.0
"""White noise and Ornstein-Uhlenbeck processes fitted to spectra by Whittle's likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from scipy.optimize import minimize

from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.process import OU_TIME_CONSTANTS, ResidualSpectrum
from thermal_comp.noise.vibration import NO_VIBRATION_NOISE, VibrationNoise

NEIGHBOUR_LN_STD = 1.2
"""Standard deviation of the difference between the ln of variances of neighbouring processes."""

TYPICAL_SLOW_SHARE, SLOW_SHARE_LN_STD = 0.2, 1.0
"""Amplitude of each process over the standard deviation of a one-second mean, and standard
deviation of its ln: bias instabilities of MEMS sensors are about a half of it. Without this prior
the most likely variance of slow noise in a short run is often zero, and effects would fit it."""

AXIS_LN_STD = 0.7
"""Standard deviation of the ln of an axis's variance of slow noise about that of all axes."""

STILL_WHITE_LN_STD, ADDED_WHITE_LN_STD = 1.0, 0.3
"""The same of white noise, and of what vibration adds to it, about the values that differences of
neighbouring blocks have: slow noise is in these too, and vibration is only nearly white."""

LEAST_VARIANCE_SHARE = 1e-9
"""Least variance of a process, as a share of the residual's."""


def fit_noise_to_spectra(
    spectra: Sequence[ResidualSpectrum], vibration: VibrationNoise = NO_VIBRATION_NOISE
) -> NoiseModel:
    """Return the noise model whose expected spectra fit best, per axis.

    `vibration` is the noise of still rows and its growth: a spectrum of all rows cannot tell
    which part of white noise vibration adds.
    """
    if not spectra:
        return NoiseModel(np.zeros(3), OU_TIME_CONSTANTS, np.zeros((len(OU_TIME_CONSTANTS), 3)))
    expected = np.concatenate([s.expected for s in spectra], axis=1)
    periodogram = np.concatenate([s.periodogram for s in spectra])
    weight = np.concatenate([s.weight for s in spectra])
    scale = np.maximum((periodogram * weight[:, None]).sum(axis=0), 1e-300) / np.maximum(
        (expected[0] * weight).sum(), 1e-300
    )
    periodogram, levels = periodogram / scale, np.zeros((0, 3))
    if vibration.density.any():
        expected = np.vstack([expected, np.concatenate([s.shaken for s in spectra])])
        levels = np.stack([vibration.white, vibration.density]) / scale
    usual = _usual_noise(levels.mean(axis=1))
    common = np.log(_whittle(periodogram.mean(axis=1), expected, weight * 3.0, usual))
    variances = np.stack(
        [
            _whittle(axis, expected, weight, _noise_near(common, level))
            for axis, level in zip(periodogram.T, levels.T, strict=True)
        ],
        axis=1,
    )
    slow = slice(1, len(OU_TIME_CONSTANTS) + 1)
    added = variances[slow.stop :] if len(levels) else np.zeros((1, 3))
    return NoiseModel(
        white=np.sqrt(variances[0] * scale),
        time_constants=spectra[0].time_constants,
        amplitudes=np.sqrt(variances[slow] * scale),
        per_vibration=added[0] * scale,
        still_vibration=vibration.still,
    )


@dataclass(frozen=True, eq=False)
class _Prior:
    """Normal distribution of the ln of variances: white, slow processes, added by vibration."""

    centre: FloatArray
    precision: FloatArray


def _usual_noise(levels: FloatArray) -> _Prior:
    """Return the prior of the noise of a MEMS sensor; `levels` as in `_with_white`.

    Slow noise is a share of white noise.
    """
    slow = len(OU_TIME_CONSTANTS)
    level = np.r_[-1.0, np.full(slow, 1.0 / slow)]
    precision = _smoothness_precision() + np.outer(level, level) / (2.0 * SLOW_SHARE_LN_STD) ** 2
    white = np.log(max(levels[0], LEAST_VARIANCE_SHARE)) if len(levels) else 0.0
    centre = white + np.r_[0.0, np.full(slow, 2.0 * np.log(TYPICAL_SLOW_SHARE))]
    return _with_white(_Prior(centre, precision), levels)


def _noise_near(common: FloatArray, levels: FloatArray) -> _Prior:
    """Return the prior of one axis near what is `common` to all; `levels` as in `_with_white`."""
    slow = len(OU_TIME_CONSTANTS)
    precision = _smoothness_precision() + np.diag(np.r_[0.0, np.full(slow, 1.0 / AXIS_LN_STD**2)])
    return _with_white(_Prior(common[: slow + 1], precision), levels)


def _with_white(prior: _Prior, levels: FloatArray) -> _Prior:
    """Return the prior with the levels (2,) of white noise: of still rows, added by vibration.

    () where vibration adds none.
    """
    if not len(levels):
        return prior
    still, added = np.log(np.maximum(levels, LEAST_VARIANCE_SHARE))
    precision = np.zeros((len(prior.centre) + 1, len(prior.centre) + 1))
    precision[:-1, :-1] = prior.precision
    precision[[0, -1], [0, -1]] += np.array([STILL_WHITE_LN_STD, ADDED_WHITE_LN_STD]) ** -2.0
    return _Prior(np.r_[still, prior.centre[1:], added], precision)


def _whittle(
    periodogram: FloatArray, expected: FloatArray, weight: FloatArray, prior: _Prior
) -> FloatArray:
    """Return the variances (k,) that maximise Σ w (−I/m − ln m) plus the prior's log.

    m (f,) = Σ variance · expected.
    """
    found = minimize(
        _minus_log_posterior,
        np.minimum(prior.centre, 0.0),
        args=(periodogram, expected, weight, prior),
        method='trust-exact',
        jac=True,
        hess=_information,
    )
    variances: FloatArray = np.maximum(np.exp(found.x), LEAST_VARIANCE_SHARE)
    return variances


def _minus_log_posterior(
    log_variance: FloatArray,
    periodogram: FloatArray,
    expected: FloatArray,
    weight: FloatArray,
    prior: _Prior,
) -> tuple[float, FloatArray]:
    """Return what `_whittle` minimises, and its gradient (k,)."""
    share = np.exp(log_variance)[:, None] * expected
    spectrum = np.maximum(share.sum(axis=0), 1e-300)
    ratio, away = periodogram / spectrum, log_variance - prior.centre
    value = weight @ (ratio + np.log(spectrum)) + 0.5 * away @ prior.precision @ away
    return float(value), (share / spectrum) @ (weight * (1.0 - ratio)) + prior.precision @ away


def _information(
    log_variance: FloatArray,
    periodogram: FloatArray,  # noqa: ARG001 (the expectation of the second derivatives)
    expected: FloatArray,
    weight: FloatArray,
    prior: _Prior,
) -> FloatArray:
    """Return the (k, k) expected curvature of what `_whittle` minimises."""
    share = np.exp(log_variance)[:, None] * expected
    share /= np.maximum(share.sum(axis=0), 1e-300)
    information: FloatArray = (share * weight) @ share.T + prior.precision
    return information


def _smoothness_precision() -> FloatArray:
    """Return the precision of steps between neighbouring processes; white noise is free."""
    order = len(OU_TIME_CONSTANTS) + 1
    steps = np.diff(np.eye(order)[1:], axis=0)
    return np.asarray(steps.T @ steps) / NEIGHBOUR_LN_STD**2 + 1e-6 * np.eye(order)
