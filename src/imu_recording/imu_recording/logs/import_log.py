# SPDX-License-Identifier: Apache-2.0
"""The IMUs of a log, each as a recording."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from imu_recording.held_temperature import note_held
from imu_recording.logs.dataflash import is_dataflash, read_dataflash
from imu_recording.logs.flight_log import FlightLog, LogError, LoggedImu, Series
from imu_recording.logs.ulog import is_ulog, read_ulog
from imu_recording.recording import (
    FloatArray,
    ImuRecording,
    IntArray,
    RecordingError,
    infer_up_axis,
)
from imu_recording.synchronise import (
    Samples,
    hold_newest,
    in_order,
    interpolate,
    join_next,
    without_jumps,
)

BLACKBOX_MAGIC = b'H Product:Black'
"""First bytes of a Blackbox log (Betaflight, iNav, Cleanflight and others)."""
LOG_SUFFIXES = {
    '.ulg': 'PX4 ULog',
    '.bin': 'ArduPilot DataFlash log',
    '.bbl': 'Blackbox log',
}
BLACKBOX_REFUSAL = (
    'a Blackbox log tells nothing about temperature: Betaflight writes none of its IMU into it, '
    'and rates of iNav are whole °/s. Record the IMU with its temperature otherwise (PX4 .ulg, '
    'ArduPilot .bin, a bag, CSV)'
)


@dataclass(frozen=True, eq=False)
class ImportedImu:
    """One IMU of a log as a recording, and what else its bag is to say."""

    name: str
    """imu0, imu1 …"""
    recording: ImuRecording
    metadata: dict[str, str]
    """hardware and parameters of the log, JSON each."""


def import_log(path: str | Path) -> list[ImportedImu]:
    """Read the IMUs of a PX4 ULog or an ArduPilot DataFlash log.

    Rows follow the gyroscope; where the accelerometer has other times, it is interpolated between
    its samples. Axes are those of the autopilot, forward-right-down, as logged. Stamps are dates
    where GPS tells them, else they count from power-on. An IMU without a temperature is left out
    and named. Raises LogError.
    """
    path = Path(path)
    try:
        with path.open('rb') as stream:
            start = stream.read(16)
    except OSError as error:
        raise LogError(f'{path}: cannot be read ({error.strerror})') from None
    if start.startswith(BLACKBOX_MAGIC):
        raise LogError(f'{path}: {BLACKBOX_REFUSAL}')
    if not (is_ulog(start) or is_dataflash(start)):
        raise LogError(f'{path}: neither a PX4 ULog nor an ArduPilot DataFlash log')
    with np.errstate(invalid='ignore'):  # damaged bytes may be signalling NaN
        return _imported(path, read_ulog(path) if is_ulog(start) else read_dataflash(path))


def _imported(path: Path, log: FlightLog) -> list[ImportedImu]:
    recordings: dict[str, ImportedImu] = {}
    left_out: list[str] = []
    for imu in log.imus:
        try:
            recording = _recording(log, imu)
        except RecordingError as error:
            left_out.append(f'IMU {imu.number}: {error}')
        else:
            name = f'imu{imu.number}'
            recordings[name] = ImportedImu(name, recording, _metadata(log, imu))
    if not recordings:
        raise LogError(f'{path}: {"; ".join(left_out)}')
    return [
        replace(imu, recording=imu.recording.with_notes(*(f'left out, {why}' for why in left_out)))
        for imu in recordings.values()
    ]


def is_log(path: Path) -> bool:
    """Tell whether a file begins like a log of an autopilot.

    Raises LogError where its name says that it is one and its first bytes say that it is not.
    """
    try:
        with path.open('rb') as stream:
            start = stream.read(16)
    except OSError:
        return False
    known = is_ulog(start) or is_dataflash(start) or start.startswith(BLACKBOX_MAGIC)
    named = LOG_SUFFIXES.get(path.suffix.lower())
    if named and not known:
        why = 'its first bytes are not those of one' if start else 'it is empty'
        raise LogError(f'{path}: no {named} ({why}); copy it again from the board')
    return known


def _metadata(log: FlightLog, imu: LoggedImu) -> dict[str, str]:
    hardware = {**log.hardware, **imu.hardware}
    return {
        'log_hardware': json.dumps(hardware, sort_keys=True),
        'log_parameters': json.dumps(dict(log.parameters), sort_keys=True),
    }


def _recording(log: FlightLog, imu: LoggedImu) -> ImuRecording:
    notes = [*log.notes, *imu.notes]
    rates = _samples('gyroscope', imu.gyroscope, notes)
    forces = _samples('accelerometer', imu.accelerometer, notes)
    if len(rates.stamp) < 2 or len(forces.stamp) < 2:
        raise RecordingError('fewer than two samples')
    rows = rates.stamp
    linear_acceleration, between = interpolate(rows, forces)
    if between:
        notes.append('the accelerometer is interpolated to the times of the gyroscope')
    kept = np.isfinite(linear_acceleration).all(axis=1)
    if not kept.any():
        raise RecordingError('accelerometer and gyroscope were never logged together')
    if not kept.all():
        notes.append(f'{int((~kept).sum())} rows without a sample of the accelerometer left out')
    rows = rows[kept]
    temperature, measured = _held('temperature', rows, imu.temperature, notes)
    slower = note_held(measured, temperature, notes)
    board, _ = _held('barometer temperature', rows, imu.barometer_temperature, notes)
    if imu.barometer_temperature is not None:
        notes.append('device_temperature is that of the barometer')
    pressure, _ = _held('pressure', rows, imu.pressure, notes)
    up_axis = infer_up_axis(linear_acceleration[kept])
    if up_axis:
        notes.append(f'up_axis {up_axis} is inferred from gravity')
    zero = log.power_on or 0
    if zero:
        notes.append('stamps are dates, by GPS')
    measured = measured if slower is None else slower
    return ImuRecording(
        stamp=rows + zero,
        angular_velocity=_floats(rates.values[0])[kept],
        linear_acceleration=linear_acceleration[kept],
        magnetic_field=_magnetic_field(rows, imu.magnetometer, notes),
        temperature=temperature,
        temperature_stamp=np.where(measured < 0, -1, measured + zero),
        device_temperature=board if imu.barometer_temperature is not None else None,
        pressure=pressure if imu.pressure is not None else None,
        frame_id=f'imu{imu.number}_frd',
        device=f'{log.vehicle}_imu{imu.number}',
        run=log.name,
        up_axis=up_axis,
        source=log.path,
        notes=tuple(dict.fromkeys(notes)),
    )


def _samples(name: str, series: Series, notes: list[str]) -> Samples:
    """Return the finite samples in order of time; of a clock that restarts, the longest run."""
    finite = np.isfinite(series.values).all(axis=1)
    values = np.ascontiguousarray(series.values[finite])
    samples = without_jumps(name, in_order(name, series.time[finite], (values,)))
    notes += samples.notes
    return samples


def _usable(name: str, series: Series, notes: list[str]) -> Samples | None:
    """Return the samples of what an IMU can do without; None, and a note why, where damaged."""
    try:
        samples = _samples(name, series, notes)
    except RecordingError as error:
        notes.append(f'{name} left out: {error}')
        return None
    return samples if len(samples.stamp) else None


def _held(
    name: str, rows: IntArray, series: Series | None, notes: list[str]
) -> tuple[FloatArray, IntArray]:
    """Return (n,) the newest value at each row and when it was measured, −1 before the first."""
    if series is None:
        return np.full(len(rows), np.nan), np.full(len(rows), -1)
    samples = _usable(name, series, notes)
    if samples is None:
        return np.full(len(rows), np.nan), np.full(len(rows), -1)
    if np.array_equal(samples.stamp, rows):
        return _floats(samples.values[0])[:, 0], rows
    stamped = Samples(samples.stamp, (*samples.values, samples.stamp[:, None]))
    joined = hold_newest(name, rows, stamped)
    notes += joined.notes
    measured: IntArray = np.asarray(joined.values[1], np.int64)[:, 0]
    return _floats(joined.values[0])[:, 0], measured


def _magnetic_field(rows: IntArray, series: Series | None, notes: list[str]) -> FloatArray:
    if series is None:
        notes.append('no magnetometer with this IMU: magnetic_field is NaN')
        return np.full((len(rows), 3), np.nan)
    samples = _usable('magnetometer', series, notes)
    if samples is None:
        return np.full((len(rows), 3), np.nan)
    joined = join_next('magnetometer', rows, samples)
    return _floats(joined.values[0])


def _floats(values: FloatArray | IntArray) -> FloatArray:
    return np.asarray(values, np.float64)
