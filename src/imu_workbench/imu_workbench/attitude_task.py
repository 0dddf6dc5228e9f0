# SPDX-License-Identifier: Apache-2.0
"""The orientation filters over one recording, raw and compensated, as a task."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from orientation_filters.filters import sample_rate
from orientation_filters.upsample import upsample
from thermal_comp.compensator import compensate
from thermal_comp.model import ThermalModel
from thermal_comp.startup import startup_rows

from imu_recording import ImuRecording
from imu_workbench.attitude import FULL, HALF, RAW, Attitude, estimate_attitudes

FILTER_RATE = 50.0
"""Slowest rate [Hz] the filters are run at; slower recordings are interpolated to it."""
UNUSED = (
    'chamber_temperature', 'chamber_temperature_2', 'device_temperature', 'setpoint', 'humidity',
    'heater', 'compressor', 'fan', 'supply_voltage', 'vibration', 'phase',
    'reference_orientation',
)  # fmt: skip
"""Tracks the filters do not look at."""
ALL_POINTS = 4_000
"""Points per line of all recordings together."""


@dataclass(frozen=True, eq=False)
class AttitudeTask:
    """One recording to be run through the filters, raw and compensated."""

    recording: ImuRecording
    model: ThermalModel | None
    among: int
    """Number of recordings whose lines share a page."""

    @property
    def label(self) -> str:
        """What is filtered."""
        return f'filtering {self.recording.run}'

    @property
    def size(self) -> float:
        """Rows to be filtered and looked at [10⁶]."""
        seconds = float(self.recording.time[-1]) if len(self.recording) else 0.0
        rows = FILTER_RATE * seconds if is_slow(self.recording) else 3.0 * len(self.recording)
        return rows * 1e-6

    def run(self) -> tuple[Attitude, ...]:
        """Return the attitudes; none without a model."""
        kept = settled(self.recording)
        if self.model is None or kept.sum() < 2:
            return ()
        slow = is_slow(self.recording)
        raw = self.recording if kept.all() else self.recording.rows(kept)
        found = estimate_attitudes(
            variants(raw, self.model),
            every=round(FILTER_RATE) if slow else 1,
            points=int(np.clip(ALL_POINTS / self.among, 250, 1000)),
        )
        return tuple(found)


def variants(raw: ImuRecording, model: ThermalModel) -> dict[str, ImuRecording]:
    """Return what the filters are fed with: raw, and compensated by every version of the model.

    A recording fast enough for a verdict is also taken with only its magnetometer compensated.
    """
    found = {RAW: without_tracks(raw)}
    for number, version in enumerate(model.history, 1):
        found[f'version {number}'] = without_tracks(compensate(raw, version))
    full = without_tracks(compensate(raw, model))
    if is_slow(raw):
        found[FULL] = full
        return {name: upsample(recording, FILTER_RATE) for name, recording in found.items()}
    if np.isfinite(raw.magnetic_field).any():
        found[HALF] = replace(found[RAW], magnetic_field=full.magnetic_field)
    return found | {FULL: full}


def without_tracks(recording: ImuRecording) -> ImuRecording:
    """Return the recording with what filters need and the cycle: copies become a third."""
    absent: dict[str, Any] = dict.fromkeys(UNUSED)
    return replace(recording, **absent)


def is_slow(recording: ImuRecording) -> bool:
    """Tell whether the recording has to be interpolated for the filters."""
    return not sample_rate(recording) >= 0.98 * FILTER_RATE


def settled(recording: ImuRecording) -> NDArray[np.bool_]:
    """Return (n,) the rows after the start-up transient."""
    kept = np.ones(len(recording), dtype=bool)
    kept[: startup_rows(recording)[0]] = False
    return kept
