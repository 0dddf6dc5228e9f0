# SPDX-License-Identifier: Apache-2.0
"""Noise above the reference of the sensor: by how much, and whether it is a random walk."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
import yaml
from imu_recording.recording import STANDARD_GRAVITY, ImuRecording

from thermal_comp.comparison.compare import rms_of
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.model.values import NoiseModel

REPORTED_RATIO = 1.5
"""Ratio to the reference from which noise is reported."""
SAME_CHIP_RATIO = 1.5
"""White noise of devices of one chip differs by less: 20 % is usual."""
WALK_RATIO = 3.0
"""A random walk's slow processes exceed the reference by this much more than its fast ones."""
LOG_RATIO_STD = 0.18
"""Standard deviation of the logarithm of a ratio over devices of one chip, each seen for long."""
SLOWEST_SAMPLES_S = 0.1
"""Single samples further apart than this may fold the sensor's band into theirs [s]."""
REPORTED_EVIDENCE = 9.0
"""Evidence from which noise is reported: three standard deviations."""


@dataclass(frozen=True)
class NoiseFinding:
    """Noise above the reference; ratios of standard deviations."""

    name: str | None
    """'random_walk' where the excess grows with averaging time."""
    white_ratio: float
    flicker_ratio: float | None
    """None where the reference knows no coloured noise."""
    evidence: float
    """(ln ratio / spread)²."""


@dataclass(frozen=True, eq=False)
class NoiseReference:
    """Noise that counts as normal, by sensor; sensors that it does not hold are not compared."""

    name: str
    """Whose noise it is."""
    sensors: Mapping[Sensor, NoiseModel]
    """Without processes where only the density of white noise is known."""


DENSITY_UNITS = {'µg/√Hz': 1e-6 * STANDARD_GRAVITY, '°/s/√Hz': float(np.radians(1.0))}
"""Units of datasheets and their factor from SI."""


@cache
def chip_references() -> Mapping[str, NoiseReference]:
    """Return the noise of every chip of noise_reference.yaml."""
    text = files('thermal_comp').joinpath('noise_reference.yaml').read_text('utf-8')
    table: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return {
        chip: NoiseReference(row['name'], {s: _noise_of_row(row[s]) for s in SENSORS if s in row})
        for chip, row in table.items()
    }


def _noise_of_row(row: Mapping[str, Any]) -> NoiseModel:
    """Return the noise of a sensor; a datasheet's one-sided density S has σ of 1 s means S/√2."""
    if 'density' in row:
        number, unit = row['density'].split()
        white = float(number) * DENSITY_UNITS[unit] / np.sqrt(2.0)
        return NoiseModel(np.full(3, white), np.empty(0), np.empty((0, 3)))
    return NoiseModel(np.full(3, row['white']), np.array([1.0]), np.full((1, 3), row['flicker']))


DEFAULT_CHIP = 'lsm9ds1'
"""Chip whose noise counts as normal where none is named."""


def is_shipped_chip(noise: Mapping[Sensor, NoiseModel]) -> bool:
    """Tell whether the white noise of most sensors is that of the shipped reference's chip.

    Where it is not, this is another chip, or its samples are too slow to tell: its noise is not
    to be measured by that of this one.
    """
    known = chip_references()[DEFAULT_CHIP].sensors
    ratios = [rms_of(model.white) / rms_of(known[sensor].white) for sensor, model in noise.items()]
    return 1.0 / SAME_CHIP_RATIO < float(np.median(ratios)) < SAME_CHIP_RATIO


def bandwidth_known(recordings: Sequence[ImuRecording]) -> bool:
    """Return whether every recording's rows are fast samples, or means with a variance within."""
    return all(
        r.vibration is not None or np.median(np.diff(r.stamp)) * 1e-9 <= SLOWEST_SAMPLES_S
        for r in recordings
        if len(r) > 1
    )


def noise_above_reference(
    noise: NoiseModel, reference: NoiseModel, *, duration: float, bandwidth_known: bool = False
) -> NoiseFinding | None:
    """Return what is too high, averaged over the axes; None where nothing is.

    `duration` [s] is that of all runs together: a process of time constant τ is seen duration / 2τ
    times on each axis, so that in twenty minutes the slow ones are hardly known.

    White noise is compared only where `bandwidth_known`: rows that are means, or samples fast
    enough. Single samples slower than the sensor's output fold its whole band into theirs, so
    their density exceeds the reference's without more noise. The coloured part is slow and
    stands in either; it is compared where the reference knows one.
    """
    if not noise.white.any():
        return None
    white_ratio = rms_of(noise.white) / rms_of(reference.white)
    evidences = [_evidence(white_ratio, LOG_RATIO_STD**2)] if bandwidth_known else []
    flicker_ratio, name = None, None
    if len(reference.time_constants):
        flicker = np.interp(
            np.log(noise.time_constants),
            np.log(reference.time_constants),
            np.sqrt((reference.amplitudes**2).mean(axis=1)),
        )
        amplitude = np.sqrt((noise.amplitudes**2).mean(axis=1))
        ratios = amplitude / np.maximum(flicker, 1e-300)
        flicker_ratio = rms_of(ratios)
        seen = 3.0 * duration / (2.0 * noise.time_constants)
        variance = 0.5 * float((1.0 / seen).sum()) / len(seen) ** 2
        evidences.append(_evidence(flicker_ratio, LOG_RATIO_STD**2 + variance))
        fast, slow = rms_of(ratios[:3]), rms_of(ratios[-3:])
        name = 'random_walk' if slow > WALK_RATIO * max(fast, 0.5) else None
    evidence = max(evidences, default=0.0)
    if evidence < REPORTED_EVIDENCE:
        return None
    return NoiseFinding(name, white_ratio, flicker_ratio, evidence)


def _evidence(ratio: float, variance: float) -> float:
    """Return the square of ln of a ratio over its variance; 0 for small ratios."""
    return float(np.log(ratio)) ** 2 / variance if ratio > REPORTED_RATIO else 0.0
