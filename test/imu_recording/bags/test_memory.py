# SPDX-License-Identifier: Apache-2.0
"""Reading takes memory in proportion to what it returns, whatever the storage and the order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from imu_recording.bags import writer as bag_writer
from peak_memory import peak_bytes
from recording_samples import arrays, make_recording, without_tracks

from imu_recording import read_bag, write_bag

ROWS = 60_000


@pytest.mark.parametrize(('storage', 'compression'), [('mcap', 'zstd'), ('sqlite3', 'none')])
def test_peak_is_at_most_three_times_what_is_returned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: str, compression: str
) -> None:
    recording = without_tracks(make_recording(ROWS, step_ns=10_000_000))
    order = np.arange(ROWS).reshape(-1, 50)
    order[:, :2] = order[:, 1::-1]  # one stamp of 50 steps back: everything must be sorted
    shuffled = recording.rows(order.ravel())
    monkeypatch.setattr(bag_writer, '_check', lambda *arguments: None)
    monkeypatch.setattr(bag_writer, '_stretches', lambda parts: [[(0, 0, ROWS)]])
    monkeypatch.setattr(bag_writer.np, 'lexsort', lambda keys: np.arange(len(keys[0])))
    write_bag(shuffled, tmp_path / 'b', storage=storage, compression=compression)
    monkeypatch.undo()
    found = read_bag(tmp_path / 'b')
    assert any('stepped back' in note for note in found.notes)
    assert np.array_equal(found.stamp, recording.stamp)
    returned = sum(column.nbytes for column in arrays(found).values())
    buffers = 12e6  # blocks of a file, whatever its length
    assert peak_bytes(lambda: read_bag(tmp_path / 'b')) < 3 * returned + buffers
