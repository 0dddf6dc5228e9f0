# SPDX-License-Identifier: Apache-2.0
"""A bag through the nodes' callbacks: the array path's numbers, the same bytes every time."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from imu_workbench.commands import replay as verb
from orientation_filters.filters import run_filter

from imu_recording import read_bag, write_bag


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short bag of a slowly turning sensor with a 20 Hz magnetometer."""
    rng = np.random.default_rng(3)
    n = 400
    field = np.array([2e-5, 1e-5, -4e-5]) + 1e-7 * rng.normal(size=(n, 3))
    field[np.arange(n) % 5 != 0] = np.nan
    recording = ImuRecording(
        stamp=1_700_000_000_000_000_000 + np.arange(n) * 10_000_000,
        angular_velocity=0.2 + 0.01 * rng.normal(size=(n, 3)),
        linear_acceleration=np.array([0.1, 0.2, 9.8]) + 0.01 * rng.normal(size=(n, 3)),
        magnetic_field=field,
        temperature=np.full(n, 21.5),
    )
    path = tmp_path_factory.mktemp('replay') / 'bag'
    write_bag(recording, path)
    return path


def call(*arguments: Any) -> Any:
    parser = argparse.ArgumentParser()
    verb.arguments(parser)
    return verb.run(parser.parse_args([str(a) for a in arguments]))


@pytest.mark.parametrize('node', ['ahrs_filter', 'complementary_filter'])
def test_two_runs_give_the_same_bytes_and_the_arrays_numbers(
    bag: Path, tmp_path: Path, node: str
) -> None:
    for name in ('a', 'b'):
        call(bag, '--node', node, '-p', 'preset:=robust', '-o', tmp_path / name)
    first, second = ((tmp_path / n / f'{n}_0.mcap').read_bytes() for n in ('a', 'b'))
    assert first == second
    from rosbags.highlevel import AnyReader

    with AnyReader([tmp_path / 'a']) as reader:
        connections = [c for c in reader.connections if c.topic == '/imu/data']
        messages = [
            reader.deserialize(raw, c.msgtype).orientation
            for c, _, raw in reader.messages(connections)
        ]
    result = run_filter(node.removesuffix('_filter'), read_bag(bag), preset='robust')
    got = np.array([[q.x, q.y, q.z, q.w] for q in messages])
    np.testing.assert_array_equal(got, result.orientation)


def test_golden_run_names_the_first_sample_that_moved(bag: Path, tmp_path: Path) -> None:
    golden = tmp_path / 'golden.json'
    call(bag, '--node', 'ahrs_filter', '--write-golden', golden)
    same = call(bag, '--node', 'ahrs_filter', '--check', golden)
    assert same.exit_code == 0
    assert same.content['drift'] is None
    other = 'gyroscope_noise:=2e-4'
    moved = call(bag, '--node', 'ahrs_filter', '-p', other, '--check', golden)
    assert moved.exit_code == 3
    assert 'sample 2 ' in moved.content['drift']
    wide = call(bag, '--node', 'ahrs_filter', '-p', other, '--check', golden, '--tolerance', '10')
    assert wide.exit_code == 0


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['--node', 'ahrs', '-o', 'x'], 'there are thermal_comp, complementary_filter'),
        (['--node', 'ahrs_filter'], 'nothing to do'),
        (['--node', 'ahrs_filter', '-p', 'foo:=1', '-o', 'x'], "no parameter 'foo'; it has "),
        (['--node', 'ahrs_filter', '-p', 'max_gop:=1', '-o', 'x'], 'did you mean max_gap'),
        (['--node', 'ahrs_filter', '-p', 'max_gap:=-1', '-o', 'x'], 'max_gap is -1'),
        (['--node', 'ahrs_filter', '-p', 'max_gap', '-o', 'x'], 'name:=value'),
        (['--node', 'complementary_filter', '-p', 'cutoff_hz:=60', '-o', 'x'], '60 Hz .* 100 Hz'),
        (['--node', 'ahrs_filter', '--check', 'nowhere.json'], 'no such file'),
        (['--node', 'ahrs_filter', '--topic', 'imu/data_raw:=/other', '-o', 'x'], 'no topic'),
    ],
)
def test_mistakes_are_one_clear_error(bag: Path, arguments: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call(bag, *arguments)


def test_a_mistyped_parameter_is_one_line(bag: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match='no parameter'):
        call(bag, '--node', 'complementary_filter', '-p', 'cutof_hz:=1', '-o', 'x')
    assert capfd.readouterr().err == ''


def test_a_file_that_is_no_golden_run_is_refused(bag: Path, tmp_path: Path) -> None:
    path = tmp_path / 'other.json'
    path.write_text('{"schema": 1}')
    with pytest.raises(ValueError, match='not a golden file'):
        call(bag, '--node', 'ahrs_filter', '--check', path)
