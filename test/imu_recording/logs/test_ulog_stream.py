# SPDX-License-Identifier: Apache-2.0
"""A long ULog is read piece by piece: the same values as in one, in memory that does not grow."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from imu_recording.logs import ulog, ulog_stream
from imu_recording.logs.flight_log import FlightLog
from imu_recording.logs.import_log import import_log
from log_writers import ulog_bytes
from peak_memory import peak_bytes
from recording_samples import recording_at_rest

ROWS = 4000


@pytest.fixture
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ulog_stream, 'PIECE_BYTES', 1 << 14)


def written(folder: Path, data: bytes) -> Path:
    path = folder / 'flight.ulg'
    path.write_bytes(data)
    return path


def both(path: Path, **options: int) -> tuple[FlightLog, FlightLog]:
    return ulog.read_ulog(path), ulog.read_ulog(path, whole_below=0, **options)


@pytest.mark.usefixtures('small_pieces')
def test_pieces_hold_what_the_whole_holds(tmp_path: Path) -> None:
    data = ulog_bytes(
        [recording_at_rest(ROWS), recording_at_rest(ROWS, 2)], parameters={'TC_A_ENABLE': 1.0}
    )
    whole, pieces = both(written(tmp_path, data))
    assert pieces.parameters == whole.parameters
    assert pieces.hardware == whole.hardware
    assert len(pieces.imus) == 2
    names = ['gyroscope', 'accelerometer', 'magnetometer', 'temperature', 'pressure']
    names.append('barometer_temperature')
    for one, other in zip(whole.imus, pieces.imus, strict=True):
        assert one.hardware == other.hardware
        for name in names:
            assert np.array_equal(getattr(one, name).time, getattr(other, name).time)
            assert np.array_equal(getattr(one, name).values, getattr(other, name).values)


@pytest.mark.usefixtures('small_pieces')
def test_a_longer_log_is_means_and_says_so(tmp_path: Path) -> None:
    whole, means = both(
        written(tmp_path, ulog_bytes([recording_at_rest(ROWS)])), most_rows=ROWS // 5
    )
    assert any('rows are means of 5 samples' in note for note in means.notes)
    rates = whole.imus[0].gyroscope
    expected = rates.values.reshape(-1, 5, 3).mean(axis=1)
    np.testing.assert_allclose(means.imus[0].gyroscope.values, expected, rtol=1e-12)
    assert np.array_equal(means.imus[0].gyroscope.time, rates.time[2::5])


@pytest.mark.usefixtures('small_pieces')
def test_damage_and_a_clock_that_restarts_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ulog, 'WHOLE_FILE_BYTES', 0)
    monkeypatch.setitem(ulog.read_ulog.__kwdefaults__, 'whole_below', 0)
    monkeypatch.setitem(ulog.read_ulog.__kwdefaults__, 'most_rows', 1000)
    data = ulog_bytes([recording_at_rest(ROWS)])
    again = ulog_bytes([recording_at_rest(ROWS // 4, 3)], data_alone=True)
    sync = b'\x08\x00S' + ulog_stream.SYNC_MAGIC
    torn = data + bytes(100) + sync + again
    found = import_log(written(tmp_path, torn))[0].recording
    assert len(found) == pytest.approx(ROWS / 5, abs=2)
    assert (np.diff(found.stamp) > 0).all()
    said = '; '.join(found.notes)
    assert 'the log is damaged' in said
    assert 'means of 5 samples' in said
    assert 'stretch' in said or 'clock' in said


def test_memory_does_not_grow_with_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ulog_stream, 'PIECE_BYTES', 1 << 17)
    peaks, sizes = [], []
    for length in (3, 12):
        path = written(tmp_path, ulog_bytes([recording_at_rest(length * ROWS)]))
        sizes.append(path.stat().st_size)
        peaks.append(peak_bytes(partial(ulog.read_ulog, path, whole_below=0, most_rows=1000)))
    assert sizes[1] > 3.5 * sizes[0]
    assert peaks[1] - peaks[0] < 0.2 * (sizes[1] - sizes[0])
