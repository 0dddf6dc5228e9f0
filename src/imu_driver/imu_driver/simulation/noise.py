# SPDX-License-Identifier: Apache-2.0
"""Bias instability: flicker noise as a sum of Ornstein–Uhlenbeck processes.

Processes of equal variance whose correlation times form a geometric series of ratio r have the
one-sided spectrum σ²/(ln r · f) between longest and shortest; with σ² = B² ln r / π that is the
flicker noise of IEEE 952 (B²/2πf, two-sided), whose Allan deviation is flat at
B·√(2 ln 2/π) = 0.664 B.
"""

from __future__ import annotations

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

SHORTEST_TIME_S, LONGEST_TIME_S = 10.0, 4.0e4
"""First and last correlation time [s]."""
PROCESS_COUNT = 8
"""Number of processes."""
TIME_RATIO = (LONGEST_TIME_S / SHORTEST_TIME_S) ** (1.0 / (PROCESS_COUNT - 1))
CORRELATION_TIMES = SHORTEST_TIME_S * TIME_RATIO ** np.arange(PROCESS_COUNT)
PROCESS_STD = np.sqrt(np.log(TIME_RATIO) / np.pi)
"""Standard deviation of each process for B = 1."""


@njit(cache=True)
def _sum_of_processes(
    normals: NDArray[np.float32], start: FloatArray, decay: FloatArray
) -> FloatArray:
    """Add up OU processes of unit variance: normals (p, n, axes), start (p, axes), decay (p,)."""
    processes, n, axes = normals.shape
    total = np.zeros((n, axes))
    for p in range(processes):
        kick = np.sqrt(1.0 - decay[p] * decay[p])
        for axis in range(axes):
            value = start[p, axis]
            total[0, axis] += value
            for k in range(1, n):
                value = decay[p] * value + kick * normals[p, k, axis]
                total[k, axis] += value
    return total


def flicker_noise(
    n: int, period: float, bias_instability: FloatArray, generator: np.random.Generator
) -> FloatArray:
    """Return (n, axes) flicker noise every `period` seconds, B per axis (axes,) [SI unit]."""
    axes = len(bias_instability)
    normals = generator.standard_normal((PROCESS_COUNT, n, axes), dtype=np.float32)
    start = generator.standard_normal((PROCESS_COUNT, axes))
    noise: FloatArray = _sum_of_processes(normals, start, np.exp(-period / CORRELATION_TIMES))
    noise *= PROCESS_STD * bias_instability
    return noise


def ou_process(
    n: int, period: float, time_constant: float, generator: np.random.Generator
) -> FloatArray:
    """Return (n,) an Ornstein–Uhlenbeck process of unit variance and a correlation time [s]."""
    normals = generator.standard_normal((1, n, 1), dtype=np.float32)
    start = generator.standard_normal((1, 1))
    process: FloatArray = _sum_of_processes(
        normals, start, np.array([np.exp(-period / time_constant)])
    )[:, 0]
    return process
