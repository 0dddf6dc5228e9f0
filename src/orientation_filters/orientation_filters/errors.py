# SPDX-License-Identifier: Apache-2.0
"""Attitude errors as BROAD defines them: total, about the vertical, away from the vertical.

Laidig, Caruso, Cereatti, Seel, "BROAD", Data 6(7):72, 2021: with q = estimate ⊗ truth⁻¹ in the
world, total = 2 acos|w|, heading = 2 atan|z / w|, inclination = 2 acos √(w² + z²).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from imu_recording.recording import PHASES, FloatArray, ImuRecording
from numpy.typing import NDArray

from orientation_filters.rotation.arrays import (
    conjugate,
    heading_angle,
    inclination_angle,
    multiply,
    rotation_angle,
    to_rotation_vector,
)

ERROR_KINDS = ('total', 'heading', 'inclination')


@dataclass(frozen=True, eq=False)
class AttitudeErrors:
    """Errors of every row [rad], 0 … π; NaN where estimate or truth is unknown."""

    total: FloatArray
    heading: FloatArray
    inclination: FloatArray

    def rms(self, rows: NDArray[np.bool_] | None = None) -> dict[str, float]:
        """Return the rms of each kind [rad] over the rows (all where None); NaN without rows."""
        return {kind: _rms(getattr(self, kind), rows) for kind in ERROR_KINDS}


@dataclass(frozen=True)
class ErrorGroup:
    """Rms errors [rad] of the rows of one phase or one range of temperature."""

    label: str
    rows: int
    rms: dict[str, float]


def attitude_errors(estimate: FloatArray, truth: FloatArray) -> AttitudeErrors:
    """Return the errors of attitudes (n, 4) against the truth (n, 4), same world.

    >>> truth = np.array([[0.0, 0.0, 0.0, 1.0]])
    >>> tilted = np.array([[np.sin(0.05), 0.0, 0.0, np.cos(0.05)]])
    >>> {k: round(v, 6) for k, v in attitude_errors(tilted, truth).rms().items()}
    {'total': 0.1, 'heading': 0.0, 'inclination': 0.1}
    """
    q = multiply(estimate, conjugate(truth))
    unknown = ~np.isfinite(q).all(axis=-1)
    columns = (rotation_angle(q), heading_angle(q), inclination_angle(q))
    return AttitudeErrors(*(np.where(unknown, np.nan, column) for column in columns))


def normalised_errors(
    estimate: FloatArray, truth: FloatArray, covariance: FloatArray
) -> FloatArray:
    """Return (n,) squares of the errors, normalised by their covariance (n, 3, 3), world [rad²].

    Where the covariance is true they are chi-square of three degrees of freedom: 3 in the mean.

    >>> truth = np.array([[0.0, 0.0, 0.0, 1.0]])
    >>> tilted = np.array([[np.sin(0.05), 0.0, 0.0, np.cos(0.05)]])
    >>> normalised_errors(tilted, truth, 0.01 * np.eye(3)[None]).round(6).tolist()
    [1.0]
    """
    error = to_rotation_vector(multiply(estimate, conjugate(truth)))
    known = np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    squares = np.full(len(error), np.nan)
    weighted = np.linalg.solve(covariance[known], error[known][:, :, None])[:, :, 0]
    squares[known] = np.sum(error[known] * weighted, axis=1)
    return squares


def errors_by_phase(errors: AttitudeErrors, recording: ImuRecording) -> list[ErrorGroup]:
    """Return the errors of each chamber phase that occurs, in the order of a cycle."""
    phase = recording.phase
    if phase is None:
        return []
    groups = [(name, phase == index) for index, name in enumerate(PHASES)]
    return [_group(errors, name, rows) for name, rows in groups if rows.any()]


def errors_by_temperature(
    errors: AttitudeErrors, recording: ImuRecording, step: float = 10.0
) -> list[ErrorGroup]:
    """Return the errors per range of die temperature of `step` [°C], cold to hot."""
    place = np.floor(recording.temperature / step)
    known = place[np.isfinite(place)]
    return [
        _group(errors, f'{k * step:g} … {(k + 1) * step:g} °C', place == k)
        for k in np.unique(known)
    ]


def _group(errors: AttitudeErrors, label: str, rows: NDArray[np.bool_]) -> ErrorGroup:
    return ErrorGroup(label, int(np.count_nonzero(rows)), errors.rms(rows))


def _rms(values: FloatArray, rows: NDArray[np.bool_] | None) -> float:
    chosen = values if rows is None else values[rows]
    chosen = chosen[np.isfinite(chosen)]
    return float(np.sqrt(np.mean(chosen**2))) if len(chosen) else float('nan')
