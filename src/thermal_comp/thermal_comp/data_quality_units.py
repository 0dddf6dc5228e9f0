# SPDX-License-Identifier: Apache-2.0
"""Sensors of runs whose numbers are of another unit than SI."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording

from thermal_comp.data_quality_rows import some_rows

PLAUSIBLE = {'accelerometer': (8.0, 11.5), 'magnetometer': (1e-6, 2e-3)}
"""Norm of the mean at rest [m/s², T]."""
FACTORS = {
    'accelerometer': {'g': 1.0 / 9.80665, 'mg': 1e3 / 9.80665, 'cm/s²': 100.0},
    'magnetometer': {'µT': 1e6, 'nT': 1e9, 'gauss': 1e4, 'mG': 1e7},
    'gyroscope': {'°/s': 180.0 / np.pi, 'm°/s': 180e3 / np.pi},
}
"""Numbers per SI unit of the units logs are kept in."""
FAR = 5.0
"""A norm is of no known unit where it is outside what is plausible by this factor."""
FOREIGN_NOISE = 20.0
"""Ratio of a run's noise to that of the other runs that only a wrong unit explains."""


Scale = tuple[float, float]
"""Norm of the median and median step of one sensor [its unit]."""


def scales_of(recording: ImuRecording) -> dict[str, Scale]:
    """Return how large and how noisy each sensor's numbers are; zero where there are none."""
    return {
        sensor: (_norm(getattr(recording, name)), _noise(getattr(recording, name)))
        for sensor, name in SENSOR_FIELDS.items()
    }


def foreign_units(
    scales: Sequence[Mapping[str, Scale]], names: Sequence[str], clipped: Collection[str] = ()
) -> list[tuple[int, str, str]]:
    """Return run number, sensor and a sentence for every sensor of a run in a foreign unit.

    The norm of a sensor that is `clipped` tells nothing, unless a known unit explains it.
    """
    found = []
    for sensor in SENSOR_FIELDS:
        noise = [scale[sensor][1] for scale in scales]
        for k, name in enumerate(names):
            norm = scales[k][sensor][0]
            others = [n for j, n in enumerate(noise) if j != k and n > 0.0]
            ratio = noise[k] / float(np.median(others)) if others and noise[k] > 0.0 else 1.0
            foreign = len(others) > 1 and not 1.0 / FOREIGN_NOISE < ratio < FOREIGN_NOISE
            unit = _unit_of_norm(sensor, norm) or (
                _unit_of_ratio(sensor, ratio) if foreign else ''
            )
            if foreign or unit or (sensor not in clipped and _is_far(sensor, norm)):
                text = f'run {name}: mean norm {norm:.4g}, noise × {ratio:.3g}'
                found.append((k, sensor, text + (f', as if in {unit}' if unit else '')))
    return found


def _norm(values: FloatArray) -> float:
    some = values[some_rows(len(values))]
    finite = some[np.isfinite(some).all(axis=1)]
    return float(np.linalg.norm(np.median(finite, axis=0))) if len(finite) else 0.0


def _unit_of_norm(sensor: str, norm: float) -> str:
    """Return the unit that makes an implausible norm plausible."""
    low, high = PLAUSIBLE.get(sensor, (0.0, np.inf))
    if low <= norm <= high:
        return ''
    fits = (u for u, factor in FACTORS[sensor].items() if low <= norm / factor <= high)
    return next(fits, '')


def _unit_of_ratio(sensor: str, ratio: float) -> str:
    """Return the unit whose factor is within two of the ratio of noises."""
    fits = (u for u, factor in FACTORS[sensor].items() if 0.5 < ratio / factor < 2.0)
    return next(fits, '')


def _is_far(sensor: str, norm: float) -> bool:
    low, high = PLAUSIBLE.get(sensor, (0.0, np.inf))
    return norm > 0.0 and not low / FAR <= norm <= high * FAR


def _noise(values: FloatArray) -> float:
    first = some_rows(len(values) - 1)
    steps = values[first + 1] - values[first]
    steps = steps[np.isfinite(steps).all(axis=1)]
    return float(np.median(np.abs(steps))) if len(steps) else 0.0
