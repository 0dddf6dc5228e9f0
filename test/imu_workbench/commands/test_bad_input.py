# SPDX-License-Identifier: Apache-2.0
"""A mistake is one line on standard error and exit 2; damage is excluded, counted and told."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.__main__ import main
from rosbags.rosbag2 import Reader, Writer

from imu_recording import ImuRecording, read_bag, write_bag


def fit(bag: Path, tmp_path: Path) -> int:
    return main(['fit', str(bag), '-o', str(tmp_path / 'm.yaml'), '--force'])


def refused(bag: Path, tmp_path: Path, capsys) -> str:
    """Fit and report refuse the bag in one line each; return the line."""
    assert fit(bag, tmp_path) == 2
    line = capsys.readouterr().err
    assert line.count('\n') == 1
    assert main(['report', str(bag), '-o', str(tmp_path / 'r.html')]) == 2
    assert capsys.readouterr().err.count('\n') == 1
    return line


def test_no_traceback_reaches_the_terminal(tmp_path: Path) -> None:
    argv = [sys.executable, '-m', 'imu_workbench', 'fit', str(tmp_path / 'no'), '-o', 'm.yaml']
    found = subprocess.run(argv, capture_output=True, text=True, check=False)
    assert found.returncode == 2
    assert found.stderr == f'fit: {tmp_path / "no"}: no such file or folder\n'
    assert not found.stdout


def test_an_empty_folder_and_foreign_files(tmp_path: Path, capsys) -> None:
    empty = tmp_path / 'empty'
    empty.mkdir()
    assert 'no bag in this folder' in refused(empty, tmp_path, capsys)
    text = tmp_path / 'notes.txt'
    text.write_text('not a bag')
    assert 'neither mcap nor sqlite3' in refused(text, tmp_path, capsys)


@pytest.fixture(scope='module')
def good(run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('good') / 'dut1'
    write_bag(run(cycles=2), path)
    return path


def test_a_truncated_bag_is_read_as_far_as_it_goes(good: Path, tmp_path: Path, capsys) -> None:
    whole = len(read_bag(good))
    broken = tmp_path / 'broken.mcap'
    data = next(good.glob('*.mcap')).read_bytes()
    broken.write_bytes(data[: len(data) * 2 // 3])
    recording = read_bag(broken)
    assert 0 < len(recording) < whole
    assert any('broken.mcap' in note for note in recording.notes), recording.notes
    assert fit(broken, tmp_path) == 0
    assert 'note:' in capsys.readouterr().out
    argv = ['apply', str(broken), '--model', str(tmp_path / 'm.yaml'), '-o', str(tmp_path / 'o')]
    assert main(argv) == 0
    assert 'was not closed' in capsys.readouterr().out
    broken.write_bytes(b'')
    assert 'empty' in refused(broken, tmp_path, capsys)


def test_a_topic_of_another_type(good: Path, tmp_path: Path, capsys) -> None:
    argv = ['fit', str(good), '--topic', 'imu/data_raw:=/imu/mag', '-o', str(tmp_path / 'm.yaml')]
    assert main(argv) == 2
    assert 'MagneticField, expected sensor_msgs/msg/Imu' in capsys.readouterr().err


def test_a_single_temperature(run, tmp_path: Path, capsys) -> None:
    recording = run(cycles=1)
    flat = replace(recording, temperature=np.full(len(recording), 21.5))
    write_bag(flat, tmp_path / 'flat')
    assert fit(tmp_path / 'flat', tmp_path) == 2
    assert 'span of at least' in capsys.readouterr().err
    assert main(['diagnose', str(tmp_path / 'flat')]) == 2
    said = capsys.readouterr().err
    assert 'span of at least' in said
    assert said.count('\n') == 1
    # A report can still show what was measured, and says why there is no model.
    argv = ['report', str(tmp_path / 'flat'), '--no-attitude', '-o', str(tmp_path / 'r.html')]
    assert main(argv) == 0
    assert 'span of at least' in capsys.readouterr().out


def damaged(recording: ImuRecording, field: str, rows: slice, value: float) -> ImuRecording:
    values = getattr(recording, field).copy()
    values[rows] = value
    return replace(recording, **{field: values})


@pytest.mark.parametrize(
    'value', [np.nan, *(pytest.param(v, marks=pytest.mark.long) for v in (np.inf, -np.inf))]
)
def test_samples_that_are_not_finite_are_counted(run, tmp_path: Path, capsys, value) -> None:
    clean = run(cycles=2)
    bad = damaged(clean, 'linear_acceleration', slice(100, 150), value)
    write_bag(bad, tmp_path / 'bad')
    answer = tmp_path / 'a.json'
    argv = ['fit', str(tmp_path / 'bad'), '-o', str(tmp_path / 'm.yaml'), '--json', str(answer)]
    assert main(argv) == 0
    assert '50 of' in capsys.readouterr().out
    rms = json.loads(answer.read_text())['sensors']['accelerometer']['residual_rms']
    assert max(rms) < 5e-3


@pytest.mark.parametrize('value', [pytest.param(np.nan, marks=pytest.mark.long), 3e-5])
def test_a_missing_or_constant_magnetometer_is_left_out(
    run, tmp_path: Path, capsys, value
) -> None:
    write_bag(damaged(run(cycles=2), 'magnetic_field', slice(None), value), tmp_path / 'bag')
    assert fit(tmp_path / 'bag', tmp_path) == 0
    assert 'magnetometer left out' in capsys.readouterr().out
    page = tmp_path / 'r.html'
    assert main(['report', str(tmp_path / 'bag'), '--no-attitude', '-o', str(page)]) == 0


def test_a_bag_without_one_finite_sample(run, good: Path, tmp_path: Path, capsys) -> None:
    assert fit(good, tmp_path) == 0
    capsys.readouterr()
    recording = run(cycles=1)
    for field in ('linear_acceleration', 'angular_velocity', 'magnetic_field'):
        recording = damaged(recording, field, slice(None), np.nan)
    write_bag(recording, tmp_path / 'bag')
    assert fit(tmp_path / 'bag', tmp_path) == 2
    assert 'left out' in capsys.readouterr().err
    assert main(['orient', str(tmp_path / 'bag'), '--model', str(tmp_path / 'm.yaml')]) == 2
    assert 'no attitude' in capsys.readouterr().err
    argv = ['report', str(tmp_path / 'bag'), '--no-attitude', '-o', str(tmp_path / 'r.html')]
    assert main(argv) == 0
    told = capsys.readouterr().out
    assert 'left out' in told
    assert 'linear_acceleration: 1380 of 1380 samples are NaN' in told


def test_mixed_devices_and_one_run_twice(run, good: Path, tmp_path: Path, capsys) -> None:
    write_bag(run('dut2', cycles=2), tmp_path / 'dut2')
    model = str(tmp_path / 'm.yaml')
    assert main(['fit', str(good), str(tmp_path / 'dut2'), '-o', model]) == 2
    assert 'several devices' in capsys.readouterr().err
    assert main(['fit', str(good), str(good), '-o', model]) == 2
    assert 'same data' in capsys.readouterr().err


def shuffled(source: Path, target: Path, first: int, last: int) -> None:
    """Copy a bag with the payloads of some IMU messages exchanged: stamps out of order."""
    with Reader(source) as reader, Writer(target, version=9) as writer:
        messages = list(reader.messages())
        place = [i for i, (c, _, _) in enumerate(messages) if c.topic.endswith('imu/data_raw')]
        place = place[first:last]
        order = np.random.default_rng(1).permutation(place)
        payload = {a: messages[b][2] for a, b in zip(place, order.tolist(), strict=True)}
        connections = {
            c.id: writer.add_connection(c.topic, c.msgtype, msgdef=c.msgdef.data, rihs01=c.digest)
            for c in reader.connections
        }
        for i, (connection, stamp, data) in enumerate(messages):
            writer.write(connections[connection.id], stamp, payload.get(i, data))


def test_stamps_in_disorder_are_sorted_and_said(good: Path, tmp_path: Path, capsys) -> None:
    shuffled(good, tmp_path / 'mixed', 200, 400)
    clean, again = read_bag(good), read_bag(tmp_path / 'mixed')
    np.testing.assert_array_equal(again.stamp, clean.stamp)
    np.testing.assert_array_equal(again.angular_velocity, clean.angular_velocity)
    assert len(again.notes) > len(clean.notes)
    assert fit(tmp_path / 'mixed', tmp_path) == 0
    assert 'order' in capsys.readouterr().out


def test_models_that_do_not_fit(good: Path, tmp_path: Path, capsys) -> None:
    nonsense = tmp_path / 'm.yaml'
    nonsense.write_text('schema: 99\n')
    for argv in (
        ['compare', str(good), '--model', str(nonsense)],
        ['compare', str(good), '--model', str(tmp_path)],
        ['apply', str(good), '--model', str(tmp_path / 'no.yaml'), '-o', str(tmp_path / 'o')],
        ['report', str(good), '--model', str(nonsense), '-o', str(tmp_path / 'r.html')],
    ):
        assert main(argv) == 2
        assert capsys.readouterr().err.count('\n') == 1
