# SPDX-License-Identifier: Apache-2.0
"""Does the sampling interval, by the host's clock, follow the temperature?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import ImuRecording

WINDOW_S = 120.0
"""The interval is averaged over this [s]."""


@dataclass(frozen=True)
class ClockFinding:
    """The device's clock runs at a rate that depends on temperature."""

    slope: float
    """Relative change of the sampling interval per kelvin [1/K]."""
    slope_std: float
    evidence: float
    rms_before: float
    """Rms of the relative interval about its mean [1]."""
    rms_after: float


def clock_slope(recordings: Sequence[ImuRecording]) -> ClockFinding | None:
    """Return the slope of the sampling interval over temperature; None without irregularity.

    Δt = Δt₀ (1 + k (T − T̄)) on means over WINDOW_S; the noise is what the line leaves, with
    neighbouring windows' correlation counted.
    """
    intervals, temperatures = [], []
    for recording in recordings:
        step = np.diff(recording.stamp) * 1e-9
        if len(step) < 50:
            continue
        usual = float(np.median(step))
        count = max(round(WINDOW_S / usual), 1)
        blocks = len(step) // count
        trimmed = step[: blocks * count].reshape(blocks, count)
        temperature = recording.temperature[: blocks * count].reshape(blocks, count)
        regular = (trimmed < 1.5 * usual).all(axis=1) & np.isfinite(temperature).all(axis=1)
        if not regular.any():
            continue
        relative = trimmed.mean(axis=1)[regular] / usual
        intervals.append(relative - relative.mean())
        temperatures.append(temperature.mean(axis=1)[regular])
        temperatures[-1] = temperatures[-1] - temperatures[-1].mean()
    if not intervals:
        return None
    y, x = np.concatenate(intervals), np.concatenate(temperatures)
    if len(y) < 20 or not np.ptp(y) > 1e-9 or not np.ptp(x) > 1.0:
        return None
    slope = float(x @ y / (x @ x))
    left = y - slope * x
    neighbours = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300)
    correlation = min(max(neighbours, 0.0), 0.99)
    inflation = (1.0 + correlation) / (1.0 - correlation)
    std = float(np.sqrt(left.var() * inflation / (x @ x)))
    evidence = (slope / std) ** 2 - float(np.log(len(y))) if std > 0.0 else np.inf
    return ClockFinding(
        slope,
        std,
        float(evidence),
        float(np.sqrt((y**2).mean())),
        float(np.sqrt((left**2).mean())),
    )
