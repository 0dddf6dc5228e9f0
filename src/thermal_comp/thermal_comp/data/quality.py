# SPDX-License-Identifier: Apache-2.0
"""Defects of the data themselves: which rows are wrong, and the recordings without them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from imu_recording.logging_contract import SWITCHED_FIELDS
from imu_recording.plausibility import POSSIBLE_RANGES, UNIT_FACTORS, rate_at_rest
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording

from thermal_comp.data.defective_rows import (
    BoolArray,
    pulsed_rows,
    rail_rows,
    spike_rows,
    stuck_rows,
    temperature_spikes,
)
from thermal_comp.data.parts_at_rest import parts_at_rest
from thermal_comp.data.rounding import some_rows
from thermal_comp.data.startup import startup_rows
from thermal_comp.data.thermometer import instrument_faults, stuck_temperature

IMPOSSIBLE_TEXTS = {
    'vibration': 'is no variance',
    'humidity': 'is no relative humidity (0 … 1)',
    'temperature': 'is no temperature of a working die',
    'chamber_temperature': 'is no temperature of a chamber',
    'pressure': 'is no pressure',
    'supply_voltage': 'is no supply voltage',
}
"""What a note says of impossible values, by track."""
PLAUSIBLE_NORMS = {'accelerometer': (8.0, 11.5), 'magnetometer': (1e-6, 2e-3)}
"""Norm of the mean at rest [m/s², T]."""
IMPLAUSIBLE_NORM_FACTOR = 5.0
"""Factor by which a norm outside that range is implausible, whatever the unit."""
FOREIGN_NOISE_RATIO = 20.0
"""Ratio of a run's noise to that of the other runs from which its unit is another."""

Scale = tuple[float, float]
"""Norm of the median and median step of one sensor [its unit]."""


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
        """Evidence against chance; every affected row counts ten."""
        return 10.0 * max(self.rows, 1)


def check_quality(
    recordings: Sequence[ImuRecording],
) -> tuple[list[ImuRecording], list[QualityFinding]]:
    """Return the recordings with their defective rows unknown, and what was defective."""
    findings: list[QualityFinding] = []
    clean = []
    names = [recording.run or str(number) for number, recording in enumerate(recordings, 1)]
    for name, recording in zip(names, recordings, strict=True):
        parts, found = check_motion(recording, name)
        findings += found
        for part in parts:
            mended, found = check_recording(part, part.run or name)
            clean.append(mended)
            findings += found
    names = [recording.run or str(number) for number, recording in enumerate(clean, 1)]
    for number, finding in wrong_units([scales_of(r) for r in clean], names, findings):
        rows = np.ones(len(clean[number]), dtype=bool)
        clean[number] = _without(clean[number], finding.sensor, rows)
        findings.append(replace(finding, rows=len(rows)))
    return clean, merged(findings)


def check_motion(
    recording: ImuRecording, run: str
) -> tuple[Sequence[ImuRecording], list[QualityFinding]]:
    """Return the parts in which the device stood still, and when it was moved between them."""
    found = parts_at_rest(recording)
    if not found.text:
        return found.recordings, []
    name = 'orientation_flip' if found.is_turned else 'moved'
    text = f'run {run}: {found.text}'
    return found.recordings, [QualityFinding(name, 'all', found.left_out, text)]


def check_recording(
    recording: ImuRecording, run: str
) -> tuple[ImuRecording, list[QualityFinding]]:
    """Return one recording with its defective rows unknown, and what was defective."""
    findings = []
    cut, said = startup_rows(recording)
    if cut:
        text = f'run {run}: first {cut} rows, {said}'
        findings.append(QualityFinding('startup_transient', 'all', cut, text))
    recording, found = _check_instruments(recording, run)
    findings += found
    for channel, rows, text in impossible_rows(recording):
        count = int(rows.sum())
        found_here = f'run {run}: {channel} {text} in {count} of {len(rows)} rows'
        findings.append(QualityFinding('impossible_statistic', 'all', count, found_here))
        recording = _blank(recording, channel, rows)
    rate = rate_at_rest(recording)
    if rate:
        text = f'run {run}: {rate}'
        findings.append(QualityFinding('unit_mismatch', 'gyroscope', len(recording), text))
        recording = _without(recording, 'gyroscope', np.ones(len(recording), dtype=bool))
    period = _period(recording)
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        bad = np.zeros(len(values), dtype=bool)
        for defect, rows_with in (
            ('stuck_value', partial(stuck_rows, period=period)),
            ('saturation', rail_rows),
            ('spikes', partial(spike_rows, period=period)),
        ):
            # Rows beside stuck or clipped ones are no spikes.
            rows = rows_with(np.where(bad[:, None], np.nan, values) if bad.any() else values)
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


def without_damage(recording: ImuRecording) -> tuple[ImuRecording, list[str]]:
    """Return the recording of a device at rest without damaged values, and what was cut.

    Damaged are values that repeat while they should change, and spikes.
    """
    period = _period(recording)
    stuck = {name: stuck_rows(getattr(recording, name), period) for name in SENSOR_FIELDS.values()}
    stuck['temperature'] = stuck_temperature(recording)
    notes = []
    for name, rows in stuck.items():
        if rows.any() and not rows.all():  # a track that never changes is told elsewhere
            text = f'{name}: {int(rows.sum())} of {len(rows)} rows repeat one value, left out'
            notes.append(text)
            recording = _blank(recording, name, rows)
    spikes = {
        name: spike_rows(getattr(recording, name), period) for name in SENSOR_FIELDS.values()
    }
    if any(rows.any() for rows in spikes.values()):
        switched = _switched(recording)
        spikes = {name: rows & ~switched for name, rows in spikes.items()}
    spikes['temperature'] = temperature_spikes(recording)
    for name, rows in spikes.items():
        if rows.any():
            far = getattr(recording, name)[rows]
            worst = float(far.flat[np.nanargmax(np.abs(far))])
            notes.append(
                f'{name}: {int(rows.sum())} of {len(rows)} rows far from both neighbours '
                f'(up to {worst:.3g}) left out'
            )
            recording = _blank(recording, name, rows)
    return recording, notes


def impossible_rows(recording: ImuRecording) -> list[tuple[str, BoolArray, str]]:
    """Return track, rows (n,) and a text for every track with impossible values."""
    found = []
    for name, text in IMPOSSIBLE_TEXTS.items():
        low, high = POSSIBLE_RANGES[name]
        values = getattr(recording, name)
        if values is None:
            continue
        with np.errstate(invalid='ignore'):
            wrong = ((values < low) | (values > high)).reshape(len(values), -1).any(axis=1)
        if wrong.any():
            found.append((name, wrong, text))
    return found


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

    The norm of a sensor that is `clipped` is not judged, but where a known unit explains it.
    """
    found = []
    for sensor in SENSOR_FIELDS:
        noise = [scale[sensor][1] for scale in scales]
        for k, name in enumerate(names):
            norm = scales[k][sensor][0]
            others = [n for j, n in enumerate(noise) if j != k and n > 0.0]
            ratio = noise[k] / float(np.median(others)) if others and noise[k] > 0.0 else 1.0
            foreign = (
                len(others) > 1 and not 1.0 / FOREIGN_NOISE_RATIO < ratio < FOREIGN_NOISE_RATIO
            )
            unit = _unit_of_norm(sensor, norm) or (
                _unit_of_ratio(sensor, ratio) if foreign else ''
            )
            if foreign or unit or (sensor not in clipped and _is_implausible(sensor, norm)):
                text = f'run {name}: mean norm {norm:.4g}, noise × {ratio:.3g}'
                found.append((k, sensor, text + (f', as if in {unit}' if unit else '')))
    return found


def _unit_of_norm(sensor: str, norm: float) -> str:
    """Return the unit that makes an implausible norm plausible."""
    low, high = PLAUSIBLE_NORMS.get(sensor, (0.0, np.inf))
    if low <= norm <= high:
        return ''
    fits = (u for u, factor in UNIT_FACTORS[sensor].items() if low <= norm / factor <= high)
    return next(fits, '')


def _unit_of_ratio(sensor: str, ratio: float) -> str:
    """Return the unit whose factor is within two of the ratio of noises."""
    fits = (u for u, factor in UNIT_FACTORS[sensor].items() if 0.5 < ratio / factor < 2.0)
    return next(fits, '')


def _is_implausible(sensor: str, norm: float) -> bool:
    low, high = PLAUSIBLE_NORMS.get(sensor, (0.0, np.inf))
    return (
        norm > 0.0 and not low / IMPLAUSIBLE_NORM_FACTOR <= norm <= high * IMPLAUSIBLE_NORM_FACTOR
    )


def _norm(values: FloatArray) -> float:
    some = values[some_rows(len(values))]
    finite = some[np.isfinite(some).all(axis=1)]
    return float(np.linalg.norm(np.median(finite, axis=0))) if len(finite) else 0.0


def _noise(values: FloatArray) -> float:
    first = some_rows(len(values) - 1)
    steps = values[first + 1] - values[first]
    steps = steps[np.isfinite(steps).all(axis=1)]
    return float(np.median(np.abs(steps))) if len(steps) else 0.0


def _check_instruments(
    recording: ImuRecording, run: str
) -> tuple[ImuRecording, list[QualityFinding]]:
    """Return the recording without stuck temperatures, and the faults of thermometer and clock."""
    findings = []
    for fault in instrument_faults(recording):
        count = int(fault.rows.sum())
        findings.append(QualityFinding(fault.name, 'all', count, f'run {run}: {fault.text}'))
        if fault.unusable:
            recording = _blank(recording, 'temperature', fault.rows)
    return recording, findings


def _switched(recording: ImuRecording) -> BoolArray:
    """Return the rows in which a machine of the chamber was on, or off, for one row alone."""
    switched = np.zeros(len(recording), dtype=bool)
    for name in SWITCHED_FIELDS:
        channel = getattr(recording, name)
        if channel is not None and np.isfinite(channel).any():
            switched |= pulsed_rows(np.asarray(channel, dtype=np.float64))
    return switched


def _without(recording: ImuRecording, sensor: str, rows: BoolArray) -> ImuRecording:
    return _blank(recording, SENSOR_FIELDS[sensor], rows)


def _blank(recording: ImuRecording, name: str, rows: BoolArray) -> ImuRecording:
    """Return the recording with rows of one column unknown (NaN)."""
    values = getattr(recording, name).astype(float)
    values[rows] = np.nan
    changed: dict[str, Any] = {name: values}
    return replace(recording, **changed)


def _period(recording: ImuRecording) -> float:
    return float(np.median(np.diff(recording.stamp))) * 1e-9 if len(recording) > 1 else 1.0
