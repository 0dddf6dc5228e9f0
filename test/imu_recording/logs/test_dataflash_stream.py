# SPDX-License-Identifier: Apache-2.0
"""A long DataFlash log is read piece by piece: the same values as in one, in bounded memory."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from imu_recording.logs import dataflash, dataflash_stream
from imu_recording.logs.dataflash import read_dataflash
from imu_recording.logs.import_log import import_log
from log_writers import dataflash_bytes
from peak_memory import peak_bytes
from recording_samples import recording_at_rest

ROWS = 4000
PARAMETERS = {'INS_TCAL1_ENABLE': 1.0, 'INS_TCAL1_ACC1_X': 300.0, 'AHRS_ORIENTATION': 4.0}


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataflash_stream, 'PIECE_BYTES', 1 << 14)
    monkeypatch.setattr(dataflash, 'DEFINITIONS_BYTES', 1 << 14)


def written(folder: Path, data: bytes) -> Path:
    path = folder / 'flight.bin'
    path.write_bytes(data)
    return path


@pytest.mark.usefixtures('small_pieces')
def test_pieces_hold_what_the_whole_holds(tmp_path: Path) -> None:
    data = dataflash_bytes(
        [recording_at_rest(ROWS), recording_at_rest(ROWS, 2)], parameters=PARAMETERS
    )
    path = written(tmp_path, data)
    whole, pieces = read_dataflash(path), read_dataflash(path, whole_below=0)
    assert pieces.parameters == whole.parameters
    assert pieces.hardware == whole.hardware
    assert pieces.vehicle == whole.vehicle
    assert pieces.notes == whole.notes
    assert len(pieces.imus) == 2
    names = 'gyroscope', 'accelerometer', 'magnetometer', 'temperature', 'barometer_temperature'
    for one, other in zip(whole.imus, pieces.imus, strict=True):
        assert one.notes == other.notes
        for name in names:
            assert np.array_equal(getattr(one, name).time, getattr(other, name).time)
            assert np.array_equal(getattr(one, name).values, getattr(other, name).values)


@pytest.mark.usefixtures('small_pieces')
def test_a_longer_log_is_means_and_says_so(tmp_path: Path) -> None:
    path = written(
        tmp_path, dataflash_bytes([recording_at_rest(ROWS), recording_at_rest(ROWS, 2)])
    )
    whole = read_dataflash(path)
    means = read_dataflash(path, whole_below=0, most_rows=2 * ROWS // 5)
    assert any('rows are means of 5 samples' in note for note in means.notes)
    for one, other in zip(whole.imus, means.imus, strict=True):
        expected = one.gyroscope.values.reshape(-1, 5, 3).mean(axis=1)
        np.testing.assert_allclose(other.gyroscope.values, expected, rtol=1e-12)
        assert np.array_equal(other.gyroscope.time, one.gyroscope.time[2::5])


@pytest.mark.usefixtures('small_pieces')
def test_damage_is_passed_over_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(read_dataflash.__kwdefaults__, 'whole_below', 0)
    data = dataflash_bytes([recording_at_rest(ROWS)])
    middle = len(data) // 2
    torn = data[:middle] + bytes(1000) + data[middle:]
    (imu,) = import_log(written(tmp_path, torn))
    assert ROWS - 2 <= len(imu.recording) <= ROWS
    (note,) = [note for note in imu.recording.notes if 'the log is damaged' in note]
    lost = int(note.split(':')[1].split()[0])
    assert 1000 <= lost < 1300


@pytest.mark.usefixtures('small_pieces')
def test_a_clock_that_restarts_is_cut(tmp_path: Path) -> None:
    first = dataflash_bytes([recording_at_rest(ROWS)])
    again = dataflash_bytes([recording_at_rest(ROWS // 4, 3)])
    path = written(tmp_path, first + again)
    log = read_dataflash(path, whole_below=0, most_rows=1000)
    back = np.count_nonzero(np.diff(log.imus[0].gyroscope.time) < 0)
    assert back == 1


def test_memory_does_not_grow_with_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dataflash_stream, 'PIECE_BYTES', 1 << 17)
    monkeypatch.setattr(dataflash, 'DEFINITIONS_BYTES', 1 << 14)
    peaks, sizes = [], []
    for length in (3, 12):
        path = written(tmp_path, dataflash_bytes([recording_at_rest(length * ROWS)]))
        sizes.append(path.stat().st_size)
        peaks.append(peak_bytes(partial(read_dataflash, path, whole_below=0, most_rows=1000)))
    assert sizes[1] > 3.5 * sizes[0]
    assert peaks[1] - peaks[0] < 0.2 * (sizes[1] - sizes[0])
