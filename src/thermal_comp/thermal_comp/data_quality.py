# SPDX-License-Identifier: Apache-2.0
"""What is wrong with the data before any physics: clipped, stuck, spiky, flipped, wrong unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, ImuRecording
from numpy.typing import NDArray

from thermal_comp.data_quality_channels import impossible_rows
from thermal_comp.data_quality_rows import pulsed_rows, rail_rows, spike_rows, stuck_rows
from thermal_comp.data_quality_units import Scale, foreign_units, scales_of
from thermal_comp.startup import startup_rows

BoolArray = NDArray[np.bool_]

SWITCHES = ('heater', 'compressor', 'fan')
"""Channels whose pulses a sensor may follow."""
FLIP_WINDOW_S = 300.0
"""Gravity's direction is judged on means over this [s]."""


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
    names = [recording.run or str(number) for number, recording in enumerate(recordings, 1)]
    for name, recording in zip(names, recordings, strict=True):
        mended, found = check_recording(recording, name)
        clean.append(mended)
        findings += found
    for number, finding in wrong_units([scales_of(r) for r in clean], names, findings):
        rows = np.ones(len(clean[number]), dtype=bool)
        clean[number] = _without(clean[number], finding.sensor, rows)
        findings.append(replace(finding, rows=len(rows)))
    return clean, merged(findings)


def wrong_units(
    scales: Sequence[Mapping[str, Scale]],
    names: Sequence[str],
    findings: Sequence[QualityFinding],
) -> list[tuple[int, QualityFinding]]:
    """Return run number and finding, its rows not counted, of every sensor in a foreign unit."""
    clipped = {finding.sensor for finding in findings if finding.name == 'saturation'}
    return [
        (number, QualityFinding('unit_mismatch', sensor, 0, text))
        for number, sensor, text in foreign_units(scales, names, clipped)
    ]


def check_recording(
    recording: ImuRecording, run: str
) -> tuple[ImuRecording, list[QualityFinding]]:
    """Return one recording with defective rows taken out, and what was defective."""
    findings = []
    cut, factor = startup_rows(recording)
    if cut:
        text = f'run {run}: first {cut} rows, starting at {factor:.2f} of the level'
        findings.append(QualityFinding('startup_transient', 'all', cut, text))
    for channel, rows, text in impossible_rows(recording):
        count = int(rows.sum())
        found_here = f'run {run}: {channel} {text} in {count} of {len(rows)} rows'
        findings.append(QualityFinding('impossible_statistic', 'all', count, found_here))
        recording = _blank(recording, channel, rows)
    recording, found = _check_orientation(recording, run)
    findings += found
    period = _period(recording)
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        bad = np.zeros(len(values), dtype=bool)
        for defect, judge in (
            ('stuck_value', partial(stuck_rows, period=period)),
            ('saturation', rail_rows),
            ('spikes', partial(spike_rows, period=period)),
        ):
            # The edges of what is stuck or clipped are no spikes.
            rows = judge(np.where(bad[:, None], np.nan, values) if bad.any() else values)
            rows[:cut] = False
            if defect == 'spikes' and rows.any():
                rows &= ~_switched(recording)
            if rows.any():
                text = f'run {run}: {int(rows.sum())} of {len(rows)} rows'
                findings.append(QualityFinding(defect, sensor, int(rows.sum()), text))
                bad |= rows
        if bad.any():
            recording = _without(recording, sensor, bad)
    return recording, findings


def _switched(recording: ImuRecording) -> BoolArray:
    """Return the rows in which something in the chamber was on for one row, or off."""
    switched = np.zeros(len(recording), dtype=bool)
    for name in SWITCHES:
        channel = getattr(recording, name)
        if channel is not None and np.isfinite(channel).any():
            switched |= pulsed_rows(np.asarray(channel, dtype=np.float64))
    return switched


def _without(recording: ImuRecording, sensor: str, rows: BoolArray) -> ImuRecording:
    return _blank(recording, SENSOR_FIELDS[sensor], rows)


def _blank(recording: ImuRecording, name: str, rows: BoolArray) -> ImuRecording:
    """Return the recording with rows of one column unknown; None where all of a track are."""
    values = getattr(recording, name).astype(float)
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
    parts = values[: count * window].reshape(count, window, 3)
    sizes = np.isfinite(parts).sum(axis=1)
    means = np.where(sizes > 0, np.nansum(parts, axis=1) / np.maximum(sizes, 1), np.nan)
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


def merged(findings: Sequence[QualityFinding]) -> list[QualityFinding]:
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
