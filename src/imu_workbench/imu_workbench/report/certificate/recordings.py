# SPDX-License-Identifier: Apache-2.0
"""What a certificate says of its recordings and of the conditions as they were run."""

from __future__ import annotations

import datetime as dt
from collections.abc import Sequence
from textwrap import shorten
from typing import Any

import numpy as np
from imu_recording.recording import ImuRecording
from thermal_comp.presentation.display import fixed, shown

from imu_workbench.report.laboratory import NOT_STATED

EARLIEST_YEAR = 2000
"""No MEMS IMU of nine axes was recorded before: an earlier date is that of a clock not set."""
LOSS_WORDS = (
    'not closed', 'damaged', 'lost', 'left out', 'dropouts', 'missing', 'cannot be read',
    'is empty', 'not finite', 'infinite',
)  # fmt: skip
"""Words of those notes on reading that are about loss or damage."""
MOST_LOSSES = 4
"""Notes of loss on the first page; the annex has all."""
NOTE_CHARACTERS = 140
"""Characters of a note on the first page."""
GAP_PERIODS = 3.0
"""Distance of rows from which it is a gap, in periods."""


def recording_row(recording: ImuRecording, digest: str) -> dict[str, Any]:
    """Return name, date (UTC), length, rate, orientation and hash of one recording."""
    start = dt.datetime.fromtimestamp(int(recording.stamp[0]) // 10**9, dt.UTC)
    period = float(np.median(np.diff(recording.stamp))) * 1e-9
    return {
        'name': recording.run,
        'start': start.strftime('%Y-%m-%d %H:%M')
        + ', clock not set' * (start.year < EARLIEST_YEAR),
        'hours': float(recording.time[-1]) / 3600.0,
        'rate_hz': 1.0 / period,
        'up_axis': recording.up_axis,
        'sha256': digest,
    }


def losses(recordings: Sequence[ImuRecording]) -> list[str]:
    """Return the notes on loss and damage in the recordings, and their gaps."""
    found: dict[str, list[str]] = {}
    for recording in recordings:
        told = [note for note in recording.notes if any(word in note for word in LOSS_WORDS)]
        for note in [*told, *gaps(recording)]:
            found.setdefault(shorten(note, NOTE_CHARACTERS, placeholder=' …'), []).append(
                recording.run
            )
    texts = [f'{note} ({", ".join(runs)})' for note, runs in found.items()]
    more = len(texts) - MOST_LOSSES
    return [*texts[:MOST_LOSSES], *([f'{more} more in the annex'] if more > 0 else [])]


def gaps(recording: ImuRecording) -> list[str]:
    """Return how many gaps there are between the rows, and how long they are in all."""
    step = np.diff(recording.stamp) * 1e-9
    period = float(np.median(step))
    long = step[step > GAP_PERIODS * period]
    if not len(long):
        return []
    lasting = shown(float(long.sum()) - period * len(long))
    return [f'{len(long)} gap{"s" * (len(long) > 1)}, {lasting} s in all']


def conditions(recordings: Sequence[ImuRecording], low: float, high: float) -> dict[str, str]:
    """Return plan and conditions as run, from the recordings alone."""
    profiles = sorted({r.profile for r in recordings if r.profile})
    cycles = sorted({int(r.cycle.max()) for r in recordings if r.cycle is not None})
    rates = [rate for r in recordings if (rate := ramp_rate(r)) is not None]
    led = any(r.setpoint is not None for r in recordings)
    result = {
        'plan': ', '.join(profiles) or ('set-points as recorded' if led else NOT_STATED),
        'thermal cycles per run': ', '.join(map(str, cycles)) or 'none recorded',
        'die temperature': f'{fixed(low, 1)} … {fixed(high, 1)} °C',
        'fastest change of die temperature': f'{shown(max(rates), 2)} K/min' if rates else '–',
        'orientations (axis up)': ', '.join(r.up_axis or '?' for r in recordings).replace(
            '-', '−'
        ),
    }
    for name, label, unit, factor in (
        ('chamber_temperature', 'chamber air', '°C', 1.0),
        ('humidity', 'relative humidity', '%', 100.0),
        ('supply_voltage', 'supply', 'V', 1.0),
    ):
        tracks = [t for r in recordings if (t := getattr(r, name)) is not None]
        values = np.concatenate(tracks) * factor if tracks else np.empty(0)
        values = values[np.isfinite(values)]
        if len(values):
            span = f'{shown(float(values.min()))} … {shown(float(values.max()))}'
            result[label] = f'{span} {unit}'
        else:
            result[label] = 'not recorded'
    return result


def ramp_rate(recording: ImuRecording) -> float | None:
    """Return the fastest change of die temperature over five minutes [K/min]."""
    known = np.isfinite(recording.temperature)
    time, temperature = recording.time[known], recording.temperature[known]
    if len(time) < 2 or time[-1] - time[0] < 600.0:
        return None
    at = np.arange(time[0], time[-1], 300.0)
    change = np.diff(np.interp(at, time, temperature)) / 5.0
    return float(np.abs(change).max())
