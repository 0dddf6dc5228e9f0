# SPDX-License-Identifier: Apache-2.0
"""Variances and covariances of the noise of block means."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.process import mean_autocovariance, toeplitz_product


def block_variances(noise: NoiseModel, run: PreparedRun) -> FloatArray:
    """Return the (m, 3) variances of the noise of a run's block means [unit²]."""
    noise = noise.of_run(run.name)
    variances = noise.variance_of_means(run.period) + noise.added_by(run.vibration, run.period)
    return np.broadcast_to(variances, (len(run), 3))


def noise_product(
    noise: NoiseModel,
    run: PreparedRun,
    axis: int,
    values: FloatArray,
    rows: NDArray[np.bool_] | slice = slice(None),
) -> FloatArray:
    """Return S @ values, (m, q), S the covariance of the noise of rows of a run [unit²]."""
    noise = noise.of_run(run.name)
    covariance = mean_autocovariance(noise, axis, run.period, int(run.slot[-1]) + 1)
    added = block_variances(noise, run)[rows, axis] - covariance[0]
    product: FloatArray = toeplitz_product(covariance, run.slot[rows], values)
    return product + np.asarray(added)[:, None] * values


def expected_square(noise: NoiseModel, run: PreparedRun, axis: int, operator: FloatArray) -> float:
    """Return E|operatorᵀ·noise|² summed over the operator's columns (m, q) [unit²]."""
    product = noise_product(noise, run, axis, operator)
    return float(np.einsum('mq,mq->', operator, product))
