# SPDX-License-Identifier: Apache-2.0
"""Smoothed attitude of a whole recording: a filter forward and backward, weighted by covariance.

Backward, time runs the other way: the rows are reversed and every rate has the opposite sign, so
the bias has, too. Each row is then known from the samples before it and from those after it
(two-filter smoother: Fraser, Potter, IEEE Trans. Automatic Control 14, 1969). What is wrong with
sensors and field is wrong both ways, so the two are not independent; the covariance is that of
covariance intersection with equal weights, twice that of independent estimates.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

from orientation_filters.filters import run_filter
from orientation_filters.result import OrientationResult
from orientation_filters.rotation.arrays import (
    conjugate,
    from_rotation_vector,
    multiply,
    normalised,
    to_rotation_vector,
)

PACKED = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
"""Rows and columns of xx, xy, xz, yy, yz, zz."""


def run_smoother(name: str, recording: ImuRecording, **values: Any) -> OrientationResult:
    """Return the attitude of every row from all samples, before and after it.

    Arguments and result are those of `run_filter`; the preset is `robust` where none is given, as
    `paper` has no covariance to weigh with. Where one direction has no attitude the other stands.
    """
    options = {'preset': 'robust', **values}
    forward = run_filter(name, recording, **options)
    backward = run_filter(name, reversed_in_time(recording), **options)
    q, covariance = weighted_mean(
        forward.orientation,
        forward.covariance,
        backward.orientation[::-1],
        backward.covariance[::-1],
    )
    return replace(
        forward,
        orientation=q,
        compact_covariance=covariance[:, *PACKED],
        bias=np.nanmean([forward.bias, -backward.bias[::-1]], axis=0),
    )


def reversed_in_time(recording: ImuRecording) -> ImuRecording:
    """Return what the sensors would have measured had the motion gone backward."""
    turned = recording.rows(np.arange(len(recording))[::-1])
    return replace(
        turned,
        stamp=recording.stamp[0] + recording.stamp[-1] - turned.stamp,
        angular_velocity=-turned.angular_velocity,
    )


def weighted_mean(
    q: FloatArray, p: FloatArray, other: FloatArray, other_p: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return means of attitudes (n, 4), weighted by the covariances (n, 3, 3), world, and theirs.

    >>> one, same = np.array([[0.0, 0.0, 0.0, 1.0]]), np.eye(3)[None]
    >>> turned = from_rotation_vector(np.array([[0.0, 0.0, 0.3]]))
    >>> mean, covariance = weighted_mean(one, same, turned, 2.0 * same)
    >>> to_rotation_vector(mean).round(6).tolist(), covariance[0, 0, 0].round(6).item()
    ([[0.0, 0.0, 0.1]], 1.333333)
    """
    q, p = np.where(np.isfinite(q), q, other), np.where(np.isfinite(p), p, np.inf)
    mean, covariance = q.copy(), np.full_like(p, np.nan)
    first, second = np.isfinite(p).all(axis=(1, 2)), np.isfinite(other_p).all(axis=(1, 2))
    both = first & second
    covariance[first], covariance[second & ~first] = p[first], other_p[second & ~first]
    apart = to_rotation_vector(multiply(other[both], conjugate(q[both])))
    gain = p[both] @ np.linalg.inv(p[both] + other_p[both])
    step = (gain @ apart[:, :, None])[:, :, 0]
    mean[both] = normalised(multiply(from_rotation_vector(step), q[both]))
    left = p[both] - gain @ p[both]
    covariance[both] = left + left.transpose(0, 2, 1)
    return mean, covariance
