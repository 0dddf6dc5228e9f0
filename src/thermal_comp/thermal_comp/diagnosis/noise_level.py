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
from imu_recording.recording import ImuRecording

from thermal_comp.data.conditions import Sensor
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
    flicker_ratio: float
    evidence: float
    """(ln ratio / spread)²."""


@cache
def shipped_reference() -> Mapping[str, Mapping[str, float]]:
    """Return white density and flicker amplitude of each sensor, from noise_reference.yaml."""
    text = files('thermal_comp').joinpath('noise_reference.yaml').read_text('utf-8')
    table: dict[str, Any] = yaml.safe_load(text)['lsm9ds1']
    return table


def is_reference_chip(noise: Mapping[Sensor, NoiseModel]) -> bool:
    """Tell whether the white noise of most sensors is that of the shipped reference's chip.

    Where it is not, this is another chip, or its samples are too slow to tell: its noise is not
    to be measured by that of this one.
    """
    table = shipped_reference()
    ratios = [_rms(model.white) / table[sensor]['white'] for sensor, model in noise.items()]
    return 1.0 / SAME_CHIP_RATIO < float(np.median(ratios)) < SAME_CHIP_RATIO


def bandwidth_known(recordings: Sequence[ImuRecording]) -> bool:
    """Return whether every recording's rows are fast samples, or means with a variance within."""
    return all(
        r.vibration is not None or np.median(np.diff(r.stamp)) * 1e-9 <= SLOWEST_SAMPLES_S
        for r in recordings
        if len(r) > 1
    )


def noise_above_reference(
    noise: NoiseModel,
    sensor: Sensor,
    reference: NoiseModel | None = None,
    *,
    duration: float,
    bandwidth_known: bool = False,
) -> NoiseFinding | None:
    """Return what is too high, averaged over the axes; None where nothing is.

    `duration` [s] is that of all runs together: a process of time constant τ is seen duration / 2τ
    times on each axis, so that in twenty minutes the slow ones are hardly known.

    White noise is compared only where `bandwidth_known`: rows that are means, or samples fast
    enough. Single samples slower than the sensor's output fold its whole band into theirs, so
    their density exceeds the reference's without more noise. The coloured part is slow and
    stands in either.
    """
    if not noise.white.any():
        return None
    if reference is None:
        row = shipped_reference()[sensor]
        white, flicker = row['white'], np.full(len(noise.time_constants), row['flicker'])
    else:
        white = _rms(reference.white)
        flicker = np.interp(
            np.log(noise.time_constants),
            np.log(reference.time_constants),
            np.sqrt((reference.amplitudes**2).mean(axis=1)),
        )
    amplitude = np.sqrt((noise.amplitudes**2).mean(axis=1))
    ratios = amplitude / np.maximum(flicker, 1e-300)
    white_ratio = _rms(noise.white) / white
    flicker_ratio = _rms(ratios)
    seen = 3.0 * duration / (2.0 * noise.time_constants)
    variance = 0.5 * float((1.0 / seen).sum()) / len(seen) ** 2
    evidences = [_evidence(flicker_ratio, LOG_RATIO_STD**2 + variance)]
    evidences += [_evidence(white_ratio, LOG_RATIO_STD**2)] if bandwidth_known else []
    if max(evidences) < REPORTED_EVIDENCE:
        return None
    fast, slow = _rms(ratios[:3]), _rms(ratios[-3:])
    name = 'random_walk' if slow > WALK_RATIO * max(fast, 0.5) else None
    return NoiseFinding(name, white_ratio, flicker_ratio, max(evidences))


def _evidence(ratio: float, variance: float) -> float:
    """Return how many variances the logarithm of a ratio is above nought; 0 for small ones."""
    return float(np.log(ratio)) ** 2 / variance if ratio > REPORTED_RATIO else 0.0


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))
