# SPDX-License-Identifier: Apache-2.0
"""Whatever a recording holds, writing and reading it changes no bit, and no byte is random."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from imu_recording.bags import writer as bag_writer
from imu_recording.bags import writer as encode_tracks
from recording_samples import (
    START,
    arrays,
    assert_same,
    make_recording,
    without_tracks,
)

from imu_recording import BagError, ImuRecording, bag_namespaces, read_bag, write_bag

SCALARS = (
    'chamber_temperature',
    'chamber_temperature_2',
    'device_temperature',
    'setpoint',
    'humidity',
    'pressure',
    'heater',
    'compressor',
    'fan',
    'supply_voltage',
)
finite = st.floats(allow_nan=False, allow_infinity=False)
small = st.sampled_from([0.0, -0.0, 1.0, 20.0, np.nan])


@st.composite
def recordings(draw: Any) -> ImuRecording:
    """Any finite numbers, NaN where a sample may be missing, any subset of tracks."""
    n = draw(st.integers(1, 12))
    steps = draw(hnp.arrays(np.int64, n, elements=st.integers(1, 20 * 10**9)))
    start = draw(st.sampled_from([0, 1, START, 2**31 * 10**9 - 10**12]))

    def column(width: int, elements: Any = finite) -> Any:
        return draw(hnp.arrays(np.float64, (n, width), elements=elements))

    tracks: dict[str, Any] = {}
    for name in SCALARS:
        if draw(st.booleans()):
            values = column(1, small)[:, 0]
            if np.isfinite(values).any():
                tracks[name] = values
    if draw(st.booleans()):
        tracks['vibration'] = column(3)
    if draw(st.booleans()):
        tracks['reference_orientation'] = column(4)
    if 'setpoint' in tracks or draw(st.booleans()):
        tracks['phase'] = draw(hnp.arrays(np.int64, n, elements=st.integers(0, 6)))
        tracks['cycle'] = draw(hnp.arrays(np.int64, n, elements=st.integers(0, 9)))
    text = st.text(st.characters(codec='utf-8', exclude_categories=('C', 'Zl', 'Zp')), max_size=12)
    return ImuRecording(
        stamp=start + np.cumsum(steps),
        angular_velocity=column(3, st.one_of(finite, st.just(np.nan))),
        linear_acceleration=column(3),
        magnetic_field=column(3, st.one_of(finite, st.just(np.nan))),
        temperature=column(1, st.one_of(finite, st.just(np.nan)))[:, 0],
        frame_id=draw(text),
        device=draw(text),
        run=draw(text),
        profile=draw(text),
        up_axis=draw(st.sampled_from(['+x', '-z'])),
        **tracks,
    )


@given(recordings(), st.sampled_from(['mcap', 'sqlite3']))
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_round_trip(recording: ImuRecording, storage: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'bag'
        write_bag(recording, path, storage=storage)
        assert_same(canonical(recording), canonical(read_bag(path)))


def canonical(recording: ImuRecording) -> ImuRecording:
    """One bit pattern for NaN: which of them a NaN is means nothing."""
    columns = arrays(recording)
    for name, values in columns.items():
        if values.dtype == np.float64:
            columns[name] = np.where(np.isnan(values), np.nan, values)
    return replace(recording, **columns)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_same_input_same_files(tmp_path: Path, storage: str) -> None:
    recording = make_recording(500)
    hashes = []
    for _ in range(2):
        write_bag(recording, tmp_path / 'b', storage=storage)
        hashes.append(
            {
                file.name: hashlib.sha256(file.read_bytes()).hexdigest()
                for file in (tmp_path / 'b').iterdir()
            }
        )
        shutil.rmtree(tmp_path / 'b')
    assert hashes[0] == hashes[1]
    assert len(hashes[0]) == 2


def test_stretches_do_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Writing in small stretches gives the same file as writing at once."""
    parts = [
        replace(make_recording(300, seed=k), namespace=f'/dut{k}', device=f'd{k}') for k in (1, 2)
    ]
    parts[1] = replace(parts[1], stamp=parts[1].stamp + 777_777_777)
    contents = []
    for rows in (7, 1 << 14):
        monkeypatch.setattr(bag_writer, 'ROWS_PER_STRETCH', rows)
        write_bag(parts, tmp_path / str(rows) / 'b')
        contents.append((tmp_path / str(rows) / 'b' / 'b.mcap').read_bytes())
    assert contents[0] == contents[1]
    path = tmp_path / '7' / 'b'
    assert bag_namespaces(path) == ['/dut1', '/dut2']
    for part in parts:
        assert_same(part, read_bag(path, namespace=part.namespace))


def test_slow_tracks_are_sent_on_change_and_every_ten_seconds() -> None:
    n = 1000
    recording = replace(
        make_recording(n, step_ns=100_000_000),
        fan=np.ones(n),
        setpoint=np.repeat([20.0, 30.0], n // 2),
    )
    by_topic = {t.topic: t for t in encode_tracks.encode_tracks(recording, 0, n)}
    assert len(by_topic['chamber/fan'].stamp) == 10
    assert len(by_topic['chamber/setpoint'].stamp) == 10
    assert len(by_topic['imu/temperature'].stamp) == n
    assert len(by_topic['chamber/phase'].stamp) == 7 + 9 - 1  # one change is both


def test_what_cannot_be_written(tmp_path: Path) -> None:
    recording = make_recording(10)
    write_bag(recording, tmp_path / 'b')
    with pytest.raises(BagError, match='b: exists already; remove it or name another'):
        write_bag(recording, tmp_path / 'b')
    with pytest.raises(BagError, match='stamps of dut1 do not increase'):
        write_bag(recording.rows(slice(None, None, -1)), tmp_path / 'c')
    with pytest.raises(BagError, match='recording of dut1 has no samples'):
        write_bag(recording.rows(slice(0, 0)), tmp_path / 'c')
    late = replace(recording, stamp=recording.stamp + 2**31 * 10**9)
    with pytest.raises(BagError, match='stamps of dut1 are outside 1970 … 2038'):
        write_bag(late, tmp_path / 'c')
    with pytest.raises(BagError, match='need different namespaces'):
        write_bag([recording, recording], tmp_path / 'c')
    with pytest.raises(BagError, match="storage 'csv' is none of mcap, sqlite3"):
        write_bag(recording, tmp_path / 'c', storage='csv')
    with pytest.raises(BagError, match="compression 'gzip' is none of"):
        write_bag(recording, tmp_path / 'c', compression='gzip')
    with pytest.raises(BagError, match='no recording to write'):
        write_bag([], tmp_path / 'c')
    assert not (tmp_path / 'c').exists()
    (tmp_path / 'file').touch()
    with pytest.raises(BagError, match='cannot be written'):
        write_bag(recording, tmp_path / 'file' / 'b')


def test_only_the_imu(tmp_path: Path) -> None:
    recording = without_tracks(make_recording(20))
    nothing = np.full(20, np.nan)
    recording = replace(
        recording, temperature=nothing, magnetic_field=np.full((20, 3), np.nan), up_axis=''
    )
    write_bag(recording, tmp_path / 'b')
    back = read_bag(tmp_path / 'b')
    assert_same(replace(recording, up_axis='+z'), back)
    assert 'up_axis +z is inferred from gravity' in back.notes
