# SPDX-License-Identifier: Apache-2.0
"""Cases of `thermal_real.py`: real recordings, and the parts of them that are held out."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray
from imu_recording.tables.csv_import import import_csv
from numpy.typing import NDArray
from thermal_comp.data.time_scale import time_scale
from thermal_comp.effects.operators import follow

from imu_recording import ImuRecording, read_bag

ROOT = Path(__file__).resolve().parents[1]
MEAN_S = 20.0
"""What is judged are means over this time [s]; it and those below are shorter where a recording is
(`time_scale`)."""
RATE_S = 30.0
"""Time constant of the rate that peers see [s]."""
LAGS_S = (60.0, 300.0, 1200.0)
"""Time constants of the lagged temperatures that peers see [s]."""
BLOCKS = 5
"""Parts of a recording that are held out in turn where no split is given."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Case:
    """A recording and the parts of it that are held out, each by a fit to the rest."""

    name: str
    recording: ImuRecording
    held_out: tuple[slice, ...]

    def sensors(self) -> list[str]:
        """Return the sensors with at least one measured value."""
        return [s for s in SENSOR_FIELDS if np.isfinite(values_of(self.recording, s)).any()]


@dataclass(frozen=True, eq=False)
class Fold:
    """One fit: what it sees and what it is judged on."""

    recording: ImuRecording
    train: Mask
    blocks: NDArray[np.int64]
    """(m, 2) first row of each block and the first one after it."""
    seen: Mask
    """(m,) blocks the fit sees; the others are judged."""

    def means(self, values: FloatArray) -> FloatArray:
        """Return the (m, …) block means of (n, …) rows."""
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)  # a block without any value is NaN
            return np.array([np.nanmean(values[a:b], axis=0) for a, b in self.blocks])


def values_of(recording: ImuRecording, sensor: str) -> FloatArray:
    """Return the (n, 3) measured values of a sensor."""
    values: FloatArray = getattr(recording, SENSOR_FIELDS[sensor])
    return values


def scale_of(recording: ImuRecording) -> float:
    """Return by what all times are shorter than usual."""
    return time_scale(float(recording.time[-1]))


def fold_of(recording: ImuRecording, held_out: slice) -> Fold:
    """Return the fit to all rows but the held-out ones; no block reaches over a border."""
    n = len(recording)
    train = np.ones(n, dtype=bool)
    train[held_out] = False
    rows = max(round(scale_of(recording) * MEAN_S / (float(recording.time[-1]) / (n - 1))), 1)
    borders = [0, *(np.flatnonzero(np.diff(train.astype(int))) + 1).tolist(), n]
    starts = [k for a, b in pairwise(borders) for k in range(a, b - rows + 1, rows)]
    blocks = np.array([(k, k + rows) for k in starts], dtype=np.int64)
    return Fold(recording, train, blocks, train[blocks[:, 0]])


def features(fold: Fold) -> FloatArray:
    """Return (m, 5) block means of temperature, rate and lagged minus present temperatures."""
    seconds, temperature = fold.recording.time, fold.recording.temperature
    held = np.interp(np.arange(len(temperature)), *_finite(temperature))
    times = scale_of(fold.recording) * np.array([RATE_S, *LAGS_S])
    lagged = [follow(seconds, held, lag)[0] - held for lag in times]
    return fold.means(np.column_stack([held, -lagged[0] / times[0], *lagged[1:]]))


def _finite(values: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    known = np.flatnonzero(np.isfinite(values))
    return known, values[known]


def within_range(case: Case) -> Mask:
    """Return the held-out blocks whose mean temperature the fit has seen."""
    parts = []
    for fold in (fold_of(case.recording, part) for part in case.held_out):
        temperature = fold.means(fold.recording.temperature)
        seen = temperature[fold.seen]
        held = temperature[~fold.seen]
        parts.append((held >= np.nanmin(seen)) & (held <= np.nanmax(seen)))
    return np.concatenate(parts)


def in_blocks(name: str, recording: ImuRecording) -> Case:
    """Return the case that holds out contiguous parts of a recording in turn."""
    edges = np.linspace(0, len(recording), BLOCKS + 1).astype(int).tolist()
    parts = tuple(slice(a, b) for a, b in pairwise(edges))
    return Case(f'{name}, {BLOCKS} blocks in turn', recording, parts)


def public_cases(data: Path) -> list[Case]:
    """Return the cases of the public recordings that lie in a folder."""
    cases = []
    drone = data / 'tofupilot_chamber' / 'imu_raw_data.csv'
    if drone.is_file():
        read = import_csv(drone, ROOT / 'examples' / 'tofupilot_mapping.yaml')
        cold, hot = int(read.temperature.argmin()), int(read.temperature.argmax())
        cases += [
            Case('tofupilot, last cooling (rows 6800 …)', read, (slice(6800, len(read)),)),
            Case(f'tofupilot, first cooling (rows 0 … {cold})', read, (slice(0, cold),)),
            Case(f'tofupilot, heating (rows {cold} … {hot})', read, (slice(cold, hot),)),
            in_blocks('tofupilot', read),
        ]
    board = data / 'freeimu_freezer' / 'Tempdata01-02-14.csv'
    if board.is_file():
        read = import_csv(board, ROOT / 'examples' / 'freeimu_mapping.yaml')
        cases.append(in_blocks('freeimu', read))
    return cases


def given_case(path: Path, mapping: Path | None, train: str | None) -> Case:
    """Return the case of a bag or, with a mapping, of a CSV file."""
    recording = import_csv(path, mapping) if mapping else read_bag(path)
    if train is None:
        return in_blocks(path.stem, recording)
    first, separator, last = train.partition('..')
    if not separator or not (first + last).isdigit() or int(first) >= int(last):
        raise SystemExit(f'--train {train}: expected rows a..b with a below b, e.g. 0..6799')
    a, b, n = int(first), int(last) + 1, len(recording)
    if a > 0 and b < n:
        raise SystemExit(f'--train {train}: start at row 0 or end at row {n - 1}')
    return Case(
        f'{path.stem}, fitted to {train}', recording, (slice(b, n) if a == 0 else slice(a),)
    )
