# SPDX-License-Identifier: Apache-2.0
"""What is wrong with the data before any physics: clipped, stuck, spiky, flipped, wrong unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording
from numpy.typing import NDArray

from thermal_comp.data_quality_rows import rail_rows, spike_rows, stuck_rows
from thermal_comp.startup import startup_rows

BoolArray = NDArray[np.bool_]

FLIP_WINDOW_S = 300.0
"""Gravity's direction is judged on means over this [s]."""
PLAUSIBLE = {'accelerometer': (8.0, 11.5), 'magnetometer': (1e-6, 2e-3)}
"""Norm of the mean at rest [m/s², T]."""
FOREIGN_NOISE = 20.0
"""Ratio of a run's noise to that of the other runs that only a wrong unit explains."""


@dataclass(frozen=True)
class QualityFinding:
    """One defect of the data."""

    name: str
    sensor: str
    rows: int
    """Rows affected, over all runs."""
    text: str

    @property
    def evidence(self) -> float:
        """How much stands against chance; every affected row counts ten."""
        return 10.0 * max(self.rows, 1)


def check_quality(
    recordings: Sequence[ImuRecording],
) -> tuple[list[ImuRecording], list[QualityFinding]]:
    """Return the recordings with defective rows taken out, and what was defective."""
    findings: list[QualityFinding] = []
    clean = []
    for number, recording in enumerate(recordings, 1):
        mended, found = _check_rows(recording, recording.run or str(number))
        clean.append(mended)
        findings += found
    clean, foreign = _check_units(clean)
    return clean, _merged([*findings, *foreign])


def _check_rows(recording: ImuRecording, run: str) -> tuple[ImuRecording, list[QualityFinding]]:
    findings = []
    cut, factor = startup_rows(recording)
    if cut:
        text = f'run {run}: first {cut} rows, starting at {factor:.2f} of the level'
        findings.append(QualityFinding('startup_transient', 'all', cut, text))
    recording, found = _check_orientation(recording, run)
    findings += found
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        period = _period(recording)
        bad = np.zeros(len(values), dtype=bool)
        for defect, rows in (
            ('stuck_value', stuck_rows(values, period)),
            ('saturation', rail_rows(values)),
            ('spikes', spike_rows(values, period)),
        ):
            rows[:cut] = False
            if rows.any():
                text = f'run {run}: {int(rows.sum())} of {len(rows)} rows'
                findings.append(QualityFinding(defect, sensor, int(rows.sum()), text))
                bad |= rows
        if bad.any():
            recording = _without(recording, sensor, bad)
    return recording, findings


def _without(recording: ImuRecording, sensor: str, rows: BoolArray) -> ImuRecording:
    name = SENSOR_FIELDS[sensor]
    values = getattr(recording, name).copy()
    values[rows] = np.nan
    changed: dict[str, Any] = {name: values}
    return replace(recording, **changed)


def _check_orientation(
    recording: ImuRecording, run: str
) -> tuple[ImuRecording, list[QualityFinding]]:
    """Find rows in which another axis, or the same one the other way, points up."""
    window = max(int(FLIP_WINDOW_S / _period(recording)), 1)
    values = recording.linear_acceleration
    count = len(values) // window
    if count < 3:
        return recording, []
    with np.errstate(invalid='ignore'):
        means = np.nanmean(values[: count * window].reshape(count, window, 3), axis=1)
    known = np.isfinite(means).all(axis=1)
    if known.sum() < 3:
        return recording, []
    axis = np.argmax(np.abs(np.nan_to_num(means)), axis=1)
    up = np.where(means[np.arange(count), axis] > 0.0, axis + 1, -axis - 1)
    steady = (
        np.abs(
            np.linalg.norm(means, axis=1) / np.median(np.linalg.norm(means[known], axis=1)) - 1.0
        )
        < 0.1
    )
    usual = _most_common(up[known & steady]) if (known & steady).any() else 0
    other = known & steady & (up != usual)
    if not other.any() or other.sum() < 2:
        return recording, []
    first, last = np.flatnonzero(other)[[0, -1]]
    rows = np.zeros(len(values), dtype=bool)
    rows[max(first - 1, 0) * window : min((last + 2) * window, len(values))] = True
    if last == count - 1:
        rows[first * window :] = True
    name = _up_name(int(up[first]))
    text = f'run {run}: {name} points up instead of {_up_name(int(usual))} in {rows.sum()} rows'
    for sensor in ('accelerometer', 'magnetometer'):
        recording = _without(recording, sensor, rows)
    finding = QualityFinding('orientation_flip', 'accelerometer', int(rows.sum()), text)
    return recording, [finding]


def _up_name(code: int) -> str:
    return f'{"+" if code > 0 else "-"}{"xyz"[abs(code) - 1]}'


def _most_common(codes: NDArray[np.int64]) -> int:
    values, counts = np.unique(codes, return_counts=True)
    return int(values[np.argmax(counts)])


def _check_units(
    recordings: Sequence[ImuRecording],
) -> tuple[list[ImuRecording], list[QualityFinding]]:
    findings, clean = [], list(recordings)
    for sensor, name in SENSOR_FIELDS.items():
        noise = [_noise(getattr(r, name)) for r in recordings]
        for k, recording in enumerate(recordings):
            others = [n for j, n in enumerate(noise) if j != k and n > 0.0]
            ratio = noise[k] / float(np.median(others)) if others and noise[k] > 0.0 else 1.0
            foreign = len(others) > 1 and not 1.0 / FOREIGN_NOISE < ratio < FOREIGN_NOISE
            norm = float(np.linalg.norm(np.nanmedian(getattr(recording, name), axis=0)))
            low, high = PLAUSIBLE.get(sensor, (0.0, np.inf))
            if foreign or (np.isfinite(norm) and not low <= norm <= high and norm > 0.0):
                rows = np.ones(len(recording), dtype=bool)
                clean[k] = _without(clean[k], sensor, rows)
                text = f'run {recording.run or k + 1}: mean norm {norm:.4g}, noise × {ratio:.3g}'
                findings.append(QualityFinding('unit_mismatch', sensor, len(recording), text))
    return clean, findings


def _noise(values: FloatArray) -> float:
    steps = np.diff(values, axis=0)
    steps = steps[np.isfinite(steps).all(axis=1)]
    return float(np.median(np.abs(steps))) if len(steps) else 0.0


def _merged(findings: Sequence[QualityFinding]) -> list[QualityFinding]:
    """Join the runs' findings of one kind and sensor."""
    joined: dict[tuple[str, str], QualityFinding] = {}
    for finding in findings:
        key = (finding.name, finding.sensor)
        if key in joined:
            before = joined[key]
            text = f'{before.text}; {finding.text}'
            finding = replace(before, rows=before.rows + finding.rows, text=text)  # noqa: PLW2901
        joined[key] = finding
    return sorted(joined.values(), key=lambda f: -f.rows)


def _period(recording: ImuRecording) -> float:
    return float(np.median(np.diff(recording.stamp))) * 1e-9 if len(recording) > 1 else 1.0
