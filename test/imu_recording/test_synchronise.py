# SPDX-License-Identifier: Apache-2.0
"""Stamps in disorder, different rates, missing values: sorted, joined, counted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_recording.recording import RecordingError, columns_hash
from imu_recording.synchronise import Samples, hold_newest, in_order, join_next
from recording_samples import (
    START,
    header,
    imu,
    magnetic,
    make_bag,
    plain,
    standard_messages,
    temperature,
)

from imu_recording import BagError, bag_namespaces, read_bag, synchronise, write_bag

PERIOD = 10_000_000


def samples(stamp: list[int]) -> Samples:
    return Samples(np.array(stamp), (np.array(stamp, float)[:, None],))


def test_sorting_keeps_the_first_of_equal_stamps() -> None:
    stamp = np.array([10, 30, 20, 30, 40, 10])
    values = np.arange(6.0)[:, None]
    result = in_order('x', stamp, (values,))
    assert result.stamp.tolist() == [10, 20, 30, 40]
    assert result.values[0][:, 0].tolist() == [0, 2, 1, 4]
    assert result.notes == (
        'x: stamps stepped back 2 times; sorted by stamp',
        'x: 2 samples with a repeated stamp left out',
    )


def test_join_goes_to_the_same_or_the_next_row_within_a_period() -> None:
    rows = np.array([0, 10, 20, 30, 100])
    joined = join_next('x', rows, samples([0, 3, 10, 21, 24, 31, 95, 101]))
    assert np.array_equal(joined.values[0][:, 0], [0, 10, np.nan, 24, 95], equal_nan=True)
    assert joined.unplaced == 4
    assert joined.notes == ('x: 4 of 8 samples found no row',)


@pytest.mark.parametrize('block', [1, 3, 64])
def test_blocks_do_not_show(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    rows = np.cumsum(rng.integers(5, 15, 200))
    taken = samples(np.cumsum(rng.integers(1, 20, 200)).tolist())
    whole = join_next('x', rows, taken), hold_newest('x', rows, taken)
    monkeypatch.setattr(synchronise, 'ROWS_PER_BLOCK', block)
    parts = join_next('x', rows, taken), hold_newest('x', rows, taken)
    for one, other in zip(whole, parts, strict=True):
        assert np.array_equal(one.values[0], other.values[0], equal_nan=True)
        assert (one.unplaced, one.notes) == (other.unplaced, other.notes)


def test_hold_takes_the_newest_not_later() -> None:
    rows = np.array([0, 10, 20, 30])
    held = hold_newest('x', rows, samples([5, 10, 18, 19, 31]))
    assert np.array_equal(held.values[0][:, 0], [np.nan, 10, 19, 19], equal_nan=True)
    assert (held.unplaced, held.notes) == (1, ())  # where the recording ended, no more
    none = hold_newest('x', rows, samples([50, 51, 52]))
    assert np.isnan(none.values[0]).all()
    assert none.notes == (
        'x: 3 of 3 samples found no row',
        'x: 4 rows lie before its first sample',
    )


def test_a_track_that_ended_early_is_named(tmp_path: Path) -> None:
    minute = 60 * 10**9
    messages: list[tuple[str, int, Any]] = [
        ('/imu/data_raw', t, imu(t)) for t in range(START, START + 10 * minute, minute)
    ]
    messages += [('/chamber/temperature', START, temperature(START))]
    messages += [('/chamber/setpoint', START, temperature(START))]
    notes = read_bag(make_bag(tmp_path / 'b', messages)).notes
    assert 'chamber/temperature ends 540 s before the last row, its last value is held' in notes
    assert not any(note.startswith('chamber/setpoint ends') for note in notes)


def test_disorder_in_a_bag(tmp_path: Path) -> None:
    """Shuffled, repeated and doubled messages read like the clean ones."""
    clean = read_bag(make_bag(tmp_path / 'clean', standard_messages()))
    messages = standard_messages()
    order = np.random.default_rng(3).permutation(len(messages))
    shuffled = [messages[i] for i in order] + messages[:30]
    mixed = [(topic, START + i, message) for i, (topic, _, message) in enumerate(shuffled)]
    found = read_bag(make_bag(tmp_path / 'mixed', mixed))
    for name in ('stamp', 'angular_velocity', 'magnetic_field', 'temperature'):
        assert np.array_equal(getattr(clean, name), getattr(found, name)), name
    assert any('imu/data_raw: 10 samples with a repeated stamp' in note for note in found.notes)


def test_slow_magnetometer_and_temperature(tmp_path: Path) -> None:
    messages: list[tuple[str, int, Any]] = [
        ('/imu/data_raw', START + i * PERIOD, imu(START + i * PERIOD)) for i in range(100)
    ]
    messages += [
        ('/imu/mag', START + i, magnetic(START + i * PERIOD - 1000, i)) for i in range(0, 100, 10)
    ]
    messages += [
        ('/imu/temperature', START, temperature(START + i * PERIOD + 5, i)) for i in (0, 50)
    ]
    recording = read_bag(make_bag(tmp_path / 'b', messages))
    assert np.flatnonzero(np.isfinite(recording.magnetic_field[:, 0])).tolist() == [
        *range(0, 100, 10)
    ]
    assert np.isnan(recording.temperature[0])
    assert recording.temperature[1:51].tolist() == [0.0] * 50
    assert recording.temperature[51:].tolist() == [50.0] * 49
    first, second = START + 5, START + 50 * PERIOD + 5
    assert recording.temperature_stamp.tolist() == [-1, *[first] * 50, *[second] * 49]
    write_bag(recording, tmp_path / 'again')
    again = read_bag(tmp_path / 'again')
    assert np.array_equal(again.temperature, recording.temperature, equal_nan=True)
    assert np.array_equal(again.temperature_stamp, recording.temperature_stamp)
    assert columns_hash(again) == columns_hash(recording)


def test_stamps_that_were_never_set(tmp_path: Path) -> None:
    messages = [('/imu/data_raw', START + i, imu(0, i)) for i in range(10)]
    recording = read_bag(make_bag(tmp_path / 'none', messages))
    assert recording.stamp.tolist() == [START + i for i in range(10)]
    assert 'imu/data_raw: stamps are not set, times of receipt stand in' in recording.notes
    messages[4:] = [('/imu/data_raw', START + i, imu(START + i, i)) for i in range(4, 10)]
    recording = read_bag(make_bag(tmp_path / 'some', messages))
    assert len(recording) == 6
    assert 'imu/data_raw: 4 samples without a stamp left out' in recording.notes


@pytest.mark.parametrize(('factor', 'word'), [(1e-3, 'slower'), (1e3, 'faster')])
def test_stamps_in_another_unit_are_refused(tmp_path: Path, factor: float, word: str) -> None:
    messages = [
        ('/imu/data_raw', START + i * PERIOD, imu(START + round(i * PERIOD * factor), i))
        for i in range(100)
    ]
    with pytest.raises(BagError, match=f'imu/data_raw advance 1000 times {word}'):
        read_bag(make_bag(tmp_path / 'b', messages))


def test_names_stay_in_their_line(tmp_path: Path) -> None:
    recording = read_bag(make_bag(tmp_path / 'b', standard_messages(20)))
    named = replace(recording, device='a\nb\x1b[2J', run='up\r')
    write_bag(named, tmp_path / 'named')
    again = read_bag(tmp_path / 'named')
    assert (again.device, again.run) == ('a b [2J', 'up ')


def test_not_a_number_is_kept_and_counted(tmp_path: Path) -> None:
    messages = standard_messages(20)
    messages[4] = ('/imu/data_raw', START, imu(START + PERIOD, np.nan))
    messages[7] = ('/imu/data_raw', START, imu(START + 2 * PERIOD, np.inf))
    messages[9] = ('/imu/temperature', START, temperature(START + 3 * PERIOD, -np.inf))
    recording = read_bag(make_bag(tmp_path / 'b', messages))
    assert len(recording) == 20
    assert np.isnan(recording.angular_velocity[1:3]).all()
    assert np.isfinite(recording.angular_velocity[3:]).all()
    assert np.isnan(recording.temperature).tolist() == [i == 3 for i in range(20)]
    assert {note for note in recording.notes if 'kept as NaN' in note} == {
        'imu/data_raw angular_velocity: 2 of 20 samples are NaN or infinite, kept as NaN',
        'imu/temperature: 1 of 20 samples are NaN or infinite, kept as NaN',
    }


def test_several_devices_and_one_chamber(tmp_path: Path) -> None:
    messages: list[tuple[str, int, Any]] = []
    for i in range(5):
        t = START + i
        for k in (1, 2):
            messages.append((f'/dut{k}/imu/data_raw', t, imu(t, k)))
            messages.append((f'/dut{k}/chamber/device_temperature', t, temperature(t, k)))
        messages.append(('/chamber/temperature', t, temperature(t, 20.0)))
        messages.append(('/chamber/fan', t, plain('Float64', 1.0)))
        messages.append(('/dut1/imu_compensated/data_raw', t, imu(t, 7)))
    custom = {'/dut1/device': 'A', '/dut2/device': 'B', 'profile': 'p'}
    path = make_bag(tmp_path / 'b', messages, custom=custom)
    assert bag_namespaces(path) == ['/dut1', '/dut2']
    with pytest.raises(BagError, match='choose one with --namespace: /dut1, /dut2'):
        read_bag(path)
    with pytest.raises(BagError, match="namespace 'dut3'; namespaces that have one: /dut1, /dut2"):
        read_bag(path, namespace='dut3')
    for k, name in ((1, '/dut1'), (2, 'dut2')):
        recording = read_bag(path, namespace=name)
        assert recording.namespace == f'/dut{k}'
        assert (recording.device, recording.profile) == ('AB'[k - 1], 'p')
        assert recording.angular_velocity[0, 0] == k
        assert recording.device_temperature is not None
        assert recording.device_temperature[0] == k
        assert recording.chamber_temperature is not None
        assert recording.fan is not None
    other = read_bag(path, namespace='/dut1', remap={'imu/data_raw': 'imu_compensated/data_raw'})
    assert other.angular_velocity[0, 0] == 7
    assert read_bag(path, namespace='/dut1', remap={'chamber/fan': ''}).fan is None


def test_remaps_and_wrong_types(tmp_path: Path) -> None:
    messages = [('/sensor', START + i, imu(START + i)) for i in range(3)]
    messages += [('/imu/mag', START + i, imu(START + i)) for i in range(3)]
    path = make_bag(tmp_path / 'b', messages)
    with pytest.raises(BagError, match='name one with --topic imu/data_raw:=/imu/mag'):
        read_bag(path)
    with pytest.raises(BagError, match=r'/imu/mag is sensor_msgs/msg/Imu, expected .*Magnetic'):
        read_bag(path, remap={'imu/data_raw': '/sensor'})
    with pytest.raises(BagError, match="no topic '/other'"):
        read_bag(path, remap={'imu/data_raw': 'other'})
    with pytest.raises(BagError, match="'imu/raw': no such name in a recording"):
        read_bag(path, remap={'imu/raw': 'other'})
    recording = read_bag(path, remap={'imu/data_raw': 'sensor', 'imu/mag': ''})
    assert np.isnan(recording.magnetic_field).all()
    assert 'no samples on imu/mag: magnetic_field is NaN' in recording.notes


def test_parts_of_one_recording(tmp_path: Path) -> None:
    whole = standard_messages(40)
    custom = {'device': 'a', 'up_axis': '+z'}
    first = make_bag(tmp_path / 'first', whole[:60], custom=custom)
    second = make_bag(tmp_path / 'second', whole[60:], custom=custom, storage='sqlite3')
    recording = read_bag([second, first])
    assert np.array_equal(recording.angular_velocity[:, 0], np.arange(40))
    other = make_bag(tmp_path / 'other', whole[60:], custom={'device': 'b'})
    with pytest.raises(BagError, match=r'device is b, that of .*first is a'):
        read_bag([first, other])


def test_up_axis_is_told_or_inferred(tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'b', standard_messages(20))
    assert read_bag(path).up_axis == '+z'
    assert 'up_axis +z is inferred from gravity' in read_bag(path).notes
    path = make_bag(tmp_path / 'c', standard_messages(20), custom={'up_axis': '-x'})
    assert read_bag(path).up_axis == '-x'
    assert 'up_axis is -x in the metadata, gravity says +z' in read_bag(path).notes


def test_frame_of_the_magnetometer_differs(tmp_path: Path) -> None:
    messages = standard_messages(5)
    for _, _, message in messages[2::3]:
        message.header = header(START, 'mag_link')
    notes = read_bag(make_bag(tmp_path / 'b', messages)).notes
    assert 'imu/mag: frame_id mag_link is not imu_link' in notes


SECOND = 1_000_000_000
NOW = 1_700_000_000 * SECOND


def clean(*parts: np.ndarray) -> tuple[Samples, list[str]]:
    """Return what the stamps of the rows become, and what is said."""
    stamp = np.concatenate(parts)
    ordered = in_order('x', stamp, (np.arange(float(len(stamp)))[:, None],))
    found = synchronise.without_jumps('x', ordered)
    return found, list(found.notes)


def test_stamps_from_before_the_clock_was_set_are_cut_off() -> None:
    seconds = np.arange(1000) * SECOND
    for early in (seconds[:10], seconds[:1], seconds[:10] + NOW - 30 * 86_400 * SECOND):
        found, notes = clean(early, NOW + seconds)
        assert np.array_equal(found.stamp, NOW + seconds)
        assert f'{len(early)} of {1000 + len(early)} samples' in notes[0]
        assert len(found.values[0]) == 1000


def test_of_two_times_a_clock_stamped_twice_one_is_kept() -> None:
    seconds = np.arange(1000) * SECOND
    found, notes = clean(NOW + seconds[:100], NOW - 50 * SECOND + seconds)
    assert (np.diff(found.stamp) == SECOND).all()
    assert 'clock was set back 1 times, by up to 149 s: 100 samples' in notes[0]


def test_a_stretch_stamped_twice_as_a_whole_leaves_nothing_of_it() -> None:
    seconds = np.arange(1000) * SECOND
    again = np.r_[NOW + seconds, NOW + seconds[100:110], NOW + seconds[50:60]]
    found, _ = clean(again)
    assert np.array_equal(found.stamp, NOW + seconds)


def test_files_in_another_order_lose_nothing() -> None:
    seconds = np.arange(1000) * SECOND
    found, notes = clean(NOW + seconds[500:], NOW + seconds[:500])
    assert np.array_equal(found.stamp, NOW + seconds)
    assert notes == ['x: stamps stepped back 1 times; sorted by stamp']


def test_one_late_message_is_no_clock_that_was_set_back() -> None:
    seconds = NOW + np.arange(1000) * SECOND
    order = np.r_[0:500, 501:510, 500, 510:1000]
    found, _ = clean(seconds[order])
    assert np.array_equal(found.stamp, seconds)


def test_samples_spread_over_months_one_by_one_are_refused() -> None:
    stamp = NOW + np.cumsum(np.tile([SECOND, 3 * 3600 * SECOND], 50))
    with pytest.raises(RecordingError, match='stamps cannot be right'):
        clean(stamp)


def bursts(gap_s: float, burst_s: float, count: int = 20) -> np.ndarray:
    """Stamps of bursts at 10 Hz [ns]."""
    since = np.arange(0.0, burst_s, 0.1)
    return np.round((gap_s * np.arange(count)[:, None] + since).ravel() * 1e9).astype(np.int64)


@pytest.mark.parametrize('hours', [1.0, 7.0, 24.0, 72.0])
def test_bursts_hours_and_days_apart_are_one_run(hours: float) -> None:
    stamp = bursts(hours * 3600.0, 5.0)
    assert synchronise.longest_stretch('x', stamp) == (slice(0, len(stamp)), '')


def test_a_clock_that_is_set_cuts_bursts_as_well() -> None:
    early = bursts(7 * 3600.0, 5.0)
    stamp = np.concatenate([early, bursts(7 * 3600.0, 5.0) + early[-1] + 30 * 86_400 * 10**9])
    kept, note = synchronise.longest_stretch('x', stamp)
    assert kept == slice(0, len(early))
    assert 'stamps jump 1 time, by 30 days' in note


def test_days_of_work_are_no_bursts() -> None:
    stamp = bursts(24 * 3600.0, 8 * 3600.0, count=5)
    kept, note = synchronise.longest_stretch('x', stamp)
    assert kept.stop - kept.start == len(stamp) // 5
    assert 'stamps jump 4 times, by up to 16 h' in note
