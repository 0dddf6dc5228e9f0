# SPDX-License-Identifier: Apache-2.0
"""Smoothed attitude of a whole recording: a filter forward and backward, weighted by covariance.

Backward, the rows are reversed and every rate, and so the bias, has the opposite sign. Each row is
then known from the samples before it and from those after it (two-filter smoother: Fraser, Potter,
IEEE Trans. Automatic Control 14, 1969). The weights follow from the assumed noises, which both
directions share. Errors of sensors and field affect both directions, so the two are not
independent: the covariance, with the variance factors of each direction, is twice that of the
weighted mean of independent estimates (as in covariance intersection with equal weights).
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

DEFAULT_PARAMETERS = {'preset': 'robust', 'field_weight': 20.0, 'bias_random_walk': 6e-5}
"""Differ from those of the live filters, which have to find heading and bias soon: errors of the
field, which persist and affect both directions, weigh more, and the bias walks less."""
Pair = tuple[FloatArray, FloatArray]
"""Of the filter forward and backward."""
PACKED_INDICES = ([0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2])
"""Rows and columns of xx, xy, xz, yy, yz, zz."""


def run_smoother(name: str, recording: ImuRecording, **values: Any) -> OrientationResult:
    """Return the attitude of every row from all samples, before and after it.

    Arguments and result are those of `run_filter`; what is not given is as in
    `DEFAULT_PARAMETERS`, but `paper` has no covariance to weigh with. Where one direction has no
    attitude the other stands.
    """
    back = reversed_in_time(recording)
    assumed = [
        run_filter(name, r, **{**DEFAULT_PARAMETERS, **values, 'variance_factors': False})
        for r in (recording, back)
    ]
    forward, backward = (
        run_filter(name, r, **{**DEFAULT_PARAMETERS, **values}) for r in (recording, back)
    )
    q, covariance = weighted_mean(
        (forward.orientation, backward.orientation[::-1]),
        (assumed[0].covariance, assumed[1].covariance[::-1]),
        (forward.covariance, backward.covariance[::-1]),
    )
    return replace(
        forward,
        orientation=q,
        compact_covariance=covariance[:, *PACKED_INDICES],
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


def weighted_mean(attitudes: Pair, assumed: Pair, shown: Pair) -> tuple[FloatArray, FloatArray]:
    """Return means of two attitudes (n, 4) and their covariance (n, 3, 3) [rad²], world.

    `assumed`: covariances (n, 3, 3) that give the weights; `shown`: those of the errors.

    >>> one, same = np.array([[0.0, 0.0, 0.0, 1.0]]), np.eye(3)[None]
    >>> turned = from_rotation_vector(np.array([[0.0, 0.0, 0.3]]))
    >>> mean, covariance = weighted_mean((one, turned), (same, 2.0 * same), (same, 2.0 * same))
    >>> to_rotation_vector(mean).round(6).tolist(), covariance[0, 0, 0].round(6).item()
    ([[0.0, 0.0, 0.1]], 1.333333)
    """
    q, other = attitudes
    first, second = (np.isfinite(p).all(axis=(1, 2)) for p in assumed)
    both = first & second
    mean, covariance = np.where(first[:, None], q, other), np.full_like(shown[0], np.nan)
    covariance[first], covariance[second & ~first] = shown[0][first], shown[1][second & ~first]
    apart = to_rotation_vector(multiply(other[both], conjugate(q[both])))
    gain = assumed[0][both] @ np.linalg.inv(assumed[0][both] + assumed[1][both])
    step = (gain @ apart[:, :, None])[:, :, 0]
    mean[both] = normalised(multiply(from_rotation_vector(step), q[both]))
    rest = np.eye(3) - gain
    covariance[both] = 2.0 * (
        rest @ shown[0][both] @ rest.transpose(0, 2, 1)
        + gain @ shown[1][both] @ gain.transpose(0, 2, 1)
    )
    return mean, covariance
