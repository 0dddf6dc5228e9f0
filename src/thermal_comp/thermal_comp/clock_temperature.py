# SPDX-License-Identifier: Apache-2.0
"""Does the sampling interval, by the host's clock, follow the temperature?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

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


Windows = tuple[FloatArray, FloatArray]
"""(k,) relative sampling interval and (k,) temperature [K], each about its mean."""


def clock_windows(recording: ImuRecording) -> Windows | None:
    """Return means over WINDOW_S without gaps of one recording; None where there is none."""
    step = np.diff(recording.stamp) * 1e-9
    if len(step) < 50:
        return None
    usual = float(np.median(step))
    count = max(round(WINDOW_S / usual), 1)
    blocks = len(step) // count
    trimmed = step[: blocks * count].reshape(blocks, count)
    temperature = recording.temperature[: blocks * count].reshape(blocks, count)
    regular = (trimmed < 1.5 * usual).all(axis=1) & np.isfinite(temperature).all(axis=1)
    if not regular.any():
        return None
    relative = trimmed.mean(axis=1)[regular] / usual
    means = temperature.mean(axis=1)[regular]
    return relative - relative.mean(), means - means.mean()


def slope_of_windows(windows: Sequence[Windows | None]) -> ClockFinding | None:
    """Return the slope over the windows of all recordings.

    Δt = Δt₀ (1 + k (T − T̄)); the noise is what the line leaves, with neighbouring windows'
    correlation counted.
    """
    known = [some for some in windows if some is not None]
    if not known:
        return None
    intervals, temperatures = zip(*known, strict=True)
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
