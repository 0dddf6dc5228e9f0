# SPDX-License-Identifier: Apache-2.0
"""Allan deviation of what the certified model leaves: three noise coefficients per axis.

Overlapping estimator and equivalent degrees of freedom of allantools; coefficients and units as in
IEEE Std 952 and 1293. σ²(τ) = N²/τ + (2 ln 2/π) B² + K² τ/3.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import allantools
import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, FloatArray, ImuRecording
from imu_recording.synchronise import longest_stretch
from scipy.optimize import nnls
from scipy.special import chdtri
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.noise_level import NoiseReference, bandwidth_known, chip_references
from thermal_comp.model.values import ThermalModel
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS

from imu_workbench.report.laboratory import Laboratory

CONFIDENCE_LEVEL = 0.95
LEAST_STRETCH_SAMPLES = 64
"""Samples that a stretch needs for an Allan deviation."""
LEAST_VARIANCE_SHARE = 0.5
"""Share of the variance, at the averaging time where it is largest, from which a coefficient
has a lower limit."""
FLICKER_FACTOR = 2.0 * math.log(2.0) / math.pi
DEG_PER_RAD, S_PER_HOUR, MICRO_G = math.degrees(1.0), 3600.0, 1e-6 * STANDARD_GRAVITY
ONE_SIDED_FACTOR = math.sqrt(2.0)
"""Density of one-sided white noise over the deviation of its means over a second."""
COEFFICIENTS: Mapping[str, Mapping[Sensor, tuple[str, str, float]]] = {
    'random_walk': {
        'gyroscope': ('angle random walk', '°/√h', DEG_PER_RAD * 60.0),
        'accelerometer': ('velocity random walk', 'm/s/√h', 60.0),
        'magnetometer': ('white noise', 'nT·√s', 1e9),
    },
    'bias_instability': {
        'gyroscope': ('bias instability', '°/h', DEG_PER_RAD * S_PER_HOUR),
        'accelerometer': ('bias instability', 'µg', 1.0 / MICRO_G),
        'magnetometer': ('bias instability', 'nT', 1e9),
    },
    'rate_random_walk': {
        'gyroscope': ('rate random walk', '°/h/√h', DEG_PER_RAD * S_PER_HOUR * 60.0),
        'accelerometer': ('acceleration random walk', 'µg/√h', 60.0 / MICRO_G),
        'magnetometer': ('random walk', 'nT/√h', 60.0 * 1e9),
    },
}
"""Name, unit and factor from SI of each coefficient of each sensor."""
DENSITIES: Mapping[Sensor, tuple[str, str, float]] = {
    'gyroscope': ('noise density', '°/s/√Hz', DEG_PER_RAD * ONE_SIDED_FACTOR),
    'accelerometer': ('noise density', 'µg/√Hz', ONE_SIDED_FACTOR / MICRO_G),
    'magnetometer': ('noise density', 'nT/√Hz', ONE_SIDED_FACTOR * 1e9),
}
"""The random walk once more, as a datasheet has it: one-sided."""


@dataclass(frozen=True, eq=False)
class AllanDeviation:
    """Allan deviation of one axis over all runs."""

    taus: FloatArray
    """(k,) averaging times [s]."""
    deviation: FloatArray
    """(k,) [unit]."""
    degrees: FloatArray
    """(k,) equivalent degrees of freedom."""

    def interval(self) -> tuple[FloatArray, FloatArray]:
        """(k,) and (k,) ends of the 95 % interval of the deviation, by χ² [unit]."""
        low, high = (
            self.deviation * np.sqrt(self.degrees / chdtri(self.degrees, 1.0 - p))
            for p in (0.5 + CONFIDENCE_LEVEL / 2.0, 0.5 - CONFIDENCE_LEVEL / 2.0)
        )
        return low, high


Deviations = Mapping[Sensor, Sequence[AllanDeviation | None]]
"""Of every axis of the sensors that were certified; None where there is too little."""


def allan_deviations(model: ThermalModel, runs: Sequence[PreparedRun]) -> Deviations:
    """Return the Allan deviation of what the model leaves of each sensor."""
    return {
        sensor: [allan_deviation(left_over(model, runs, sensor, axis)) for axis in range(3)]
        for sensor in SENSORS
        if sensor in model.sensors
    }


def allan_curves(found: Deviations) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Return averaging time [s], deviation and interval [display unit], by sensor and axis."""
    result: dict[str, dict[str, dict[str, list[float]]]] = {}
    for sensor, axes in found.items():
        factor = DISPLAY_UNITS[sensor].factor
        for axis, one in zip('xyz', axes, strict=True):
            if one is not None:
                low, high = one.interval()
                lines = {'tau': one.taus, 'deviation': factor * one.deviation,
                         'low': factor * low, 'high': factor * high}  # fmt: skip
                result.setdefault(sensor, {})[axis] = {
                    name: [float(f'{value:.4g}') for value in values]
                    for name, values in lines.items()
                }
    return result


def datasheet_noise(laboratory: Laboratory) -> dict[str, dict[str, float]]:
    """Return a datasheet's values by sensor and coefficient, in the units of the rows.

    As the laboratory states them, else those that are known of a chip in the device's type.
    """
    stated = laboratory.content.get('datasheet', {})
    chip = _chip(laboratory)
    of_chip = {
        sensor: {'random_walk': COEFFICIENTS['random_walk'][sensor][2] * float(noise.white[0])}
        for sensor, noise in (chip.sensors.items() if chip else ())
        if not len(noise.time_constants)  # a density of a datasheet, not a measured device
    }
    return {s: of_chip.get(s, {}) | stated.get(s, {}) for s in SENSORS}


def _chip(laboratory: Laboratory) -> NoiseReference | None:
    """Return the noise of the chip that the device's type names, None where none is held."""
    kind = re.sub('[^a-z0-9]', '', laboratory.text('device', 'type').lower())
    return next((c for name, c in chip_references().items() if name in kind), None)


def without_density(laboratory: Laboratory) -> str:
    """Return the device's chip where its datasheet is known to state no density; else ''."""
    chip = _chip(laboratory)
    silent = chip and all(len(noise.time_constants) for noise in chip.sensors.values())
    return chip.name if chip and silent else ''


def allan_content(found: Deviations, datasheet: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return one row per sensor and coefficient: a value with its 95 % interval per axis.

    `datasheet` holds values by sensor and coefficient, in the units of the rows.
    """
    rows = []
    for sensor, axes in found.items():
        fitted = [coefficients(one) if one else {} for one in axes]
        stated = datasheet.get(sensor, {})
        keyed = [(key, units[sensor]) for key, units in COEFFICIENTS.items()]
        keyed.insert(1, ('random_walk', DENSITIES[sensor]))
        for key, (name, unit, factor) in keyed:
            to_si = 1.0 / COEFFICIENTS[key][sensor][2]
            rows.append(
                {
                    'sensor': sensor,
                    'coefficient': name,
                    'unit': unit,
                    'axes': [
                        [factor * value for value in found[key]] if key in found else None
                        for found in fitted
                    ],
                    'datasheet': stated[key] * to_si * factor if key in stated else None,
                }
            )
    return rows


def rows_note(recordings: Sequence[ImuRecording]) -> str:
    """Return what the rows' averaging leaves open about white noise; '' where it is known."""
    if bandwidth_known(recordings):
        return ''
    period = max(float(np.median(np.diff(r.stamp))) * 1e-9 for r in recordings if len(r) > 1)
    return (
        f'Rows are up to {period:.3g} s apart and do not say whether they are means or single '
        'samples. White noise is that of the rows: of means the sensor’s own, of single samples '
        'it also holds what folds from higher frequencies, so that the sensor’s is less.'
    )


def left_over(
    model: ThermalModel, runs: Sequence[PreparedRun], sensor: Sensor, axis: int
) -> list[tuple[FloatArray, float]]:
    """Return samples without a gap (n,) and their period [s], of each run, model subtracted."""
    found = []
    for run in runs:
        error = model.sensors[sensor].modelled_error(run.conditions.of(sensor))[0]
        values = (run.fine_measured[sensor] - error)[:, axis]
        good = np.isfinite(values)
        if good.sum() < LEAST_STRETCH_SAMPLES:
            continue
        stamp = np.round(run.conditions.time[good] * 1e9).astype(np.int64)
        stretch, _ = longest_stretch('samples', stamp)
        period = float(np.median(np.diff(stamp))) * 1e-9
        steps = np.diff(stamp[stretch]) * 1e-9 > 1.5 * period
        edges = [0, *(np.flatnonzero(steps) + 1).tolist(), len(steps) + 1]
        first, last = max(pairwise(edges), key=lambda e: e[1] - e[0])
        if last - first >= LEAST_STRETCH_SAMPLES:
            found.append((values[good][stretch][first:last], period))
    return found


def allan_deviation(pieces: Sequence[tuple[FloatArray, float]]) -> AllanDeviation | None:
    """Return the overlapping Allan deviation of pieces with one period, None where there is none.

    Variances of pieces are averaged with their equivalent degrees of freedom (Greenhall and Riley)
    as weights; averaging times are octaves up to a quarter of the longest piece.
    """
    if not pieces:
        return None
    period = pieces[0][1]
    pieces = [piece for piece in pieces if abs(piece[1] / period - 1.0) < 0.01]
    longest = max(len(values) for values, _ in pieces)
    octaves = 2 ** np.arange(int(math.log2(longest / 4.0)) + 1, dtype=np.int64)
    weighted, degrees = np.zeros(len(octaves)), np.zeros(len(octaves))
    for values, _ in pieces:
        fits = octaves[octaves <= len(values) / 4]
        taus, deviation, _, _ = allantools.oadev(
            values - values.mean(), rate=1.0 / period, data_type='freq', taus=fits * period
        )
        for k, (tau, sigma) in enumerate(zip(taus, deviation, strict=True)):
            edf = allantools.edf_greenhall(
                alpha=noise_type(tau, taus, deviation), d=2, m=round(tau / period),
                N=len(values) + 1, overlapping=True, modified=False,
            )  # fmt: skip
            weighted[k] += edf * sigma**2
            degrees[k] += edf
    known = degrees > 0.0
    return AllanDeviation(
        np.asarray(octaves[known] * period, np.float64),
        np.sqrt(weighted[known] / degrees[known]),
        degrees[known],
    )


def noise_type(tau: float, taus: FloatArray, deviation: FloatArray) -> int:
    """Return the power of the frequency noise's spectrum at an averaging time: 0, −1 or −2."""
    slope = np.gradient(np.log(deviation), np.log(taus)) if len(taus) > 1 else np.array([-0.5])
    here = float(slope[int(np.argmin(np.abs(taus - tau)))])
    return 0 if here < -0.25 else -1 if here < 0.25 else -2


def coefficients(found: AllanDeviation) -> dict[str, tuple[float, float, float]]:
    """Return value and 95 % interval of every coefficient, SI units.

    Nonnegative least squares of the variance, each averaging time weighted by its degrees of
    freedom; the interval is that of the deviation where the coefficient's share is largest. One
    that makes less than half of the variance everywhere has an upper limit only: the whole
    variance at any averaging time.
    """
    taus = found.taus
    columns = np.column_stack([1.0 / taus, np.full(len(taus), FLICKER_FACTOR), taus / 3.0])
    variance = found.deviation**2
    weight = np.sqrt(found.degrees / 2.0) / variance
    scale = np.abs(columns * weight[:, None]).max(axis=0)
    squares = nnls(columns * weight[:, None] / scale, variance * weight)[0] / scale
    share = columns * squares
    share /= share.sum(axis=1, keepdims=True)
    result = {}
    most = found.interval()[1][:, None] / np.sqrt(columns)
    for k, key in enumerate(COEFFICIENTS):
        best = int(np.argmax(share[:, k]))
        value, degrees = math.sqrt(squares[k]), found.degrees[best]
        if share[best, k] < LEAST_VARIANCE_SHARE:
            bound = float(most[:, k].min())
            result[key] = (min(value, bound), 0.0, bound)
            continue
        low, high = (
            value * math.sqrt(degrees / chdtri(degrees, 1.0 - p))
            for p in (0.5 + CONFIDENCE_LEVEL / 2.0, 0.5 - CONFIDENCE_LEVEL / 2.0)
        )
        result[key] = (value, low, high)
    return result
