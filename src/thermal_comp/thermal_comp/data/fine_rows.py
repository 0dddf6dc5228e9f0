# SPDX-License-Identifier: Apache-2.0
"""The fine rows of a run, on which effects are evaluated: means over a second, gaps filled."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from imu_recording.held_temperature import note_held
from imu_recording.logging_contract import CHANNEL_FIELDS
from imu_recording.phase import cycles_from_temperature, phases_from_setpoint
from imu_recording.recording import SENSOR_FIELDS, ImuRecording

from thermal_comp.data.binning import bin_means, bin_variances

FINE_PERIOD_S = 1.0
"""Length of the means that effects are evaluated on [s]; slower samples are taken as they are."""
LEAST_VIBRATION_RATE_HZ = 50.0
"""Slowest sample rate [Hz] from which vibration is computed."""
STAMP_TOLERANCE = 1.02
"""Ratio by which samples of that rate may be further apart: stamps jitter, and clocks err."""
LEAST_CYCLE_ROWS = 10
"""Rows of a cycle on average, below which the rows at its ends are kept."""
LONGEST_LEADING_GAP_S = 60.0
"""A track that starts up to this long after the IMU [s] has its first value from the beginning."""


def with_measurement_stamps(recording: ImuRecording) -> tuple[ImuRecording, list[str]]:
    """Return the recording with the times of measurement of a temperature that rows repeat.

    Files are read with them; a recording that a program has made has none.
    """
    notes: list[str] = []
    if recording.temperature_stamp is None:
        stamps = note_held(recording.stamp, recording.temperature, notes)
        recording = replace(recording, temperature_stamp=stamps)
    return recording, notes


def measurement_interval(recording: ImuRecording) -> float:
    """Return the usual time between measurements of the temperature that rows repeat [s], or 0."""
    if recording.temperature_stamp is None:
        return 0.0
    steps = np.diff(recording.temperature_stamp[recording.temperature_stamp >= 0])
    return 1e-9 * float(np.median(steps[steps > 0])) if steps.any() else 0.0


def measured_temperature(recording: ImuRecording) -> ImuRecording:
    """Return the recording with the die temperature between its samples interpolated.

    Rows hold the newest sample, which is older by half an interval on average: in a ramp that
    looks like an effect of the temperature's rate.
    """
    if recording.temperature_stamp is None:
        return recording
    known = np.isfinite(recording.temperature) & (recording.temperature_stamp >= 0)
    stamp, first = np.unique(recording.temperature_stamp[known], return_index=True)
    if len(stamp) < 2:
        return recording
    values = recording.temperature[known][first]
    since = stamp - stamp[0]
    # After the last sample it goes on as before, for as long as from one sample to the next.
    since = np.append(since, 2 * since[-1] - since[-2])
    values = np.append(values, 2.0 * values[-1] - values[-2])
    between = np.interp(recording.stamp - stamp[0], since, values)
    between[~known] = np.nan
    return replace(recording, temperature=between, temperature_stamp=None)


def fine_rows(
    recording: ImuRecording, origin: int, period: float
) -> tuple[ImuRecording, list[str]]:
    """Return the recording as means over `period` [s], or as it is where it is slower.

    The bins start at `origin` [ns], whatever was cut. A bin at an end or a gap that is less than a
    quarter full is left out: its noise would be twice the others'.
    """
    notes = _bad_rows(recording)
    step = float(np.median(np.diff(recording.stamp))) * 1e-9
    if step > 0.75 * period:
        return recording, notes
    length = round(period * 1e9)
    bins = (recording.stamp - origin) // length
    starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
    edges = np.append(starts, len(bins)).astype(np.int64)
    middle = (edges[:-1] + edges[1:] - 1) // 2
    taken: dict[str, Any] = {}
    for item in fields(recording):
        column = getattr(recording, item.name)
        if isinstance(column, np.ndarray) and item.name != 'stamp':
            exact = column.dtype.kind == 'i' or item.name == 'reference_orientation'
            taken[item.name] = column[middle] if exact else bin_means(column, edges)[0]
    if recording.vibration is None and step <= STAMP_TOLERANCE / LEAST_VIBRATION_RATE_HZ:
        taken['vibration'] = bin_variances(
            recording.linear_acceleration, edges, taken['linear_acceleration']
        )
    stamp = origin + ((2 * bins[starts] + 1) * length) // 2
    rows, distance = np.diff(edges), np.diff(bins[starts])
    inside = (np.append(distance, 2) == 1) & (np.insert(distance, 0, 2) == 1)
    whole = inside | (rows >= 0.25 * np.median(rows))
    return replace(recording, stamp=stamp, **taken).rows(whole), notes


def _bad_rows(recording: ImuRecording) -> list[str]:
    """Return notes on the rows without a finite value."""
    notes: list[str] = []
    without: dict[int, list[str]] = {}
    for sensor, name in SENSOR_FIELDS.items():
        values = getattr(recording, name)
        # One value that is not finite makes the sum so.
        finite = np.isfinite(values.sum())
        bad = 0 if finite else int((~np.isfinite(values).all(axis=1)).sum())
        if bad == len(recording):
            known = np.isfinite(values).any(axis=0)
            axes = [axis for axis, some in zip('xyz', known, strict=True) if not some]
            on = f' on {", ".join(axes)}' if known.any() else ''
            notes.append(f'no {sensor} value{on}')
        elif bad:
            without.setdefault(bad, []).append(sensor)
    notes += [
        f'{bad} of {len(recording)} rows without a finite {", ".join(sensors)} value'
        for bad, sensors in without.items()
    ]
    bad = int((~np.isfinite(recording.temperature)).sum())
    if bad:
        notes.append(f'{bad} of {len(recording)} rows without a die temperature left out')
    return notes


def complete(fine: ImuRecording) -> tuple[ImuRecording, list[str]]:
    """Return rows whose other tracks have no gaps: filled with the newest value, or not used."""
    changed: dict[str, Any] = {}
    notes = []
    for name in CHANNEL_FIELDS:
        column = getattr(fine, name)
        if column is None:
            continue
        finite = np.isfinite(column).reshape(len(column), -1).all(axis=1)
        if not finite.any():
            changed[name] = None
        elif not finite.all():
            lead = (fine.stamp[int(np.argmax(finite))] - fine.stamp[0]) * 1e-9
            if lead > LONGEST_LEADING_GAP_S or not finite.mean() > 0.5:
                changed[name] = None
                notes.append(f'{name} is known in {finite.mean():.0%} of the run only: not used')
            else:
                row = np.maximum.accumulate(np.where(finite, np.arange(len(column)), 0))
                changed[name] = column[np.maximum(row, np.argmax(finite))]
    setpoint = changed.get('setpoint', fine.setpoint)
    if fine.cycle is None and setpoint is not None:
        changed['phase'], changed['cycle'] = phases_from_setpoint(fine.time, setpoint)
    cycle = changed.get('cycle', fine.cycle)
    if cycle is None or not cycle.any():
        cycle = cycles_from_temperature(fine.time, fine.temperature)
        if cycle.any():
            changed['cycle'] = cycle
            notes.append(f'{cycle.max()} thermal cycles are found in the temperature itself')
    return replace(fine, **changed), notes


def without_cycle_ends(fine: ImuRecording) -> ImuRecording:
    """Return the recording without the rows on both sides of where a cycle ends.

    Such a row may hold a share of both cycles: where each cycle has its own level, it errs by many
    times the noise. Labels that change with nearly every row are no cycles.
    """
    if fine.cycle is None:
        return fine
    ends = np.flatnonzero(np.diff(fine.cycle))
    if len(ends) * LEAST_CYCLE_ROWS > len(fine):
        return fine
    kept = np.ones(len(fine), dtype=bool)
    kept[ends] = kept[ends + 1] = False
    return fine.rows(kept)
