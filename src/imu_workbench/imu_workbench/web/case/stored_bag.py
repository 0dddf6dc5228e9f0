# SPDX-License-Identifier: Apache-2.0
"""A recording as columns on disk: read from its bag once, mapped by every tab and worker."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording
from thermal_comp.data.motion import motion_of

TEXT_FIELDS = ('frame_id', 'device', 'run', 'up_axis', 'profile', 'namespace', 'source')


@dataclass(frozen=True)
class StoredBag:
    """One recording of one device."""

    folder: Path
    device: str
    run: str
    up_axis: str
    source: str
    samples: int
    duration: float
    """[s]."""
    notes: tuple[str, ...]
    motion: str = ''
    """How the device moves; '' where it rests."""
    file_state: tuple[int, int] = (0, 0)
    """Newest modification [ns since 1970] and size [bytes] of its files when it was read."""

    def recording(self) -> ImuRecording:
        """Return the recording; its columns are mapped, not loaded."""
        described = json.loads((self.folder / 'recording.json').read_text('utf-8'))
        columns: dict[str, Any] = {
            path.stem: np.load(path, mmap_mode='r') for path in self.folder.glob('*.npy')
        }
        notes = tuple(described.pop('notes'))
        recording = ImuRecording(**columns, **described, notes=notes)
        return replace(recording, run=self.run, device=self.device)

    def stamp(self) -> np.ndarray:
        """(n,) time of measurement [ns]."""
        stamp: np.ndarray = np.load(self.folder / 'stamp.npy', mmap_mode='r')
        return stamp

    def measured(self, sensor: str) -> FloatArray:
        """(n, 3) samples of a sensor [SI unit]."""
        values: FloatArray = np.load(self.folder / f'{SENSOR_FIELDS[sensor]}.npy', mmap_mode='r')
        return values

    def temperature(self) -> FloatArray:
        """(n,) die [°C]."""
        values: FloatArray = np.load(self.folder / 'temperature.npy', mmap_mode='r')
        return values


def store_recording(
    recording: ImuRecording, folder: Path, file_state: tuple[int, int] = (0, 0)
) -> StoredBag:
    """Write the recording's columns into a folder of its own."""
    folder.mkdir(parents=True)
    for item in fields(recording):
        column = getattr(recording, item.name)
        if isinstance(column, np.ndarray):
            np.save(folder / f'{item.name}.npy', column)
    described: dict[str, Any] = {name: getattr(recording, name) for name in TEXT_FIELDS}
    described |= {'notes': list(recording.notes), 'unplaced': dict(recording.unplaced)}
    (folder / 'recording.json').write_text(json.dumps(described, ensure_ascii=False), 'utf-8')
    span = float(recording.stamp[-1] - recording.stamp[0]) * 1e-9 if len(recording) else 0.0
    return StoredBag(
        folder=folder,
        device=recording.device or recording.namespace.strip('/') or 'device',
        run=recording.run or recording.source.rstrip('/').rpartition('/')[2] or 'run',
        up_axis=recording.up_axis,
        source=recording.source,
        samples=len(recording),
        duration=span,
        notes=recording.notes,
        motion=motion_of(recording),
        file_state=file_state,
    )


def with_unique_runs(bags: Sequence[StoredBag]) -> list[StoredBag]:
    """Return the bags with a run name each that no other bag has."""
    seen: dict[str, int] = {}
    result = []
    for bag in bags:
        seen[bag.run] = seen.get(bag.run, 0) + 1
        number = seen[bag.run]
        result.append(bag if number == 1 else replace(bag, run=f'{bag.run} ({number})'))
    return result
