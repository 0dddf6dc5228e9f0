# SPDX-License-Identifier: Apache-2.0
"""Stretches at rest: found where nothing moves, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from thermal_comp.still.log import resting_log
from thermal_comp.still.rest import find_rest

from imu_recording import ImuRecording

RATE = 50.0
FALSE_REST = 0.005
"""Share of moving seconds that may be called rest: what the documentation states."""
FOUND = 0.9
BROAD = Path(__file__).resolve().parents[4] / 'shared' / 'data' / 'broad'


def recording(parts: list[tuple[float, str]], seed: int = 1) -> ImuRecording:
    """Return parts of so many seconds each: rest, elsewhere, turn, hand, shake."""
    rng = np.random.default_rng(seed)
    rates, forces = [], []
    for seconds, kind in parts:
        n = round(seconds * RATE)
        rate, force = np.zeros((n, 3)), np.tile([0.1, -0.2, 9.8], (n, 1))
        if kind == 'elsewhere':
            force = np.tile([3.0, 0.0, 9.3], (n, 1))
        if kind == 'turn':
            rate[:, 2] = 0.1
        if kind == 'hand':
            t = np.arange(n) / RATE
            rate += 0.4 * np.sin(1.7 * t)[:, None]
            force[:, 0] += 0.8 * np.sin(0.9 * t)
        if kind == 'shake':
            force += 2.0 * rng.standard_normal((n, 3))
        rates.append(rate)
        forces.append(force)
    rate, force = np.concatenate(rates), np.concatenate(forces)
    n = len(rate)
    return ImuRecording(
        stamp=np.round(np.arange(n) / RATE * 1e9).astype(np.int64),
        angular_velocity=rate + 0.01 + 2e-3 * rng.standard_normal((n, 3)),
        linear_acceleration=force + 0.02 * rng.standard_normal((n, 3)),
        magnetic_field=np.full((n, 3), np.nan),
        temperature=np.linspace(20.0, 25.0, n),
        device='dut',
        run='flight',
    )


def spans(moving: ImuRecording) -> list[tuple[int, int]]:
    """Return first and last second of each stretch."""
    found = find_rest(moving).stretches
    return [(round(s.start / RATE), round(s.stop / RATE)) for s in found]


def test_rest_between_motions_is_found_to_the_second() -> None:
    found = spans(recording([(60, 'rest'), (40, 'hand'), (50, 'rest'), (30, 'shake')]))
    assert len(found) == 2
    assert found[0] == (1, pytest.approx(59, abs=1))
    assert found[1] == (pytest.approx(101, abs=1), pytest.approx(149, abs=1))


def test_put_down_elsewhere_is_another_stretch() -> None:
    found = spans(recording([(60, 'rest'), (60, 'elsewhere')]))
    assert [round(s) for s, _ in found] == [1, 61]


def test_a_steady_turn_is_no_rest() -> None:
    rest = find_rest(recording([(60, 'rest'), (30, 'turn'), (60, 'rest')]))
    assert rest.note == '1 stretches at a steady turn are left out'
    assert [round(s.start / RATE) for s in rest.stretches] == [1, 91]


@pytest.mark.parametrize(
    ('parts', 'why'),
    [
        ([(120, 'shake')], 'quietest seconds shake'),
        ([(120, 'hand')], 'quietest seconds shake'),
        ([(15, 'rest'), (60, 'hand')], 'never rests for long enough'),
        ([(3, 'rest')], 'shorter than a stretch'),
    ],
)
def test_where_there_is_no_rest_it_says_why(parts: list[tuple[float, str]], why: str) -> None:
    rest = find_rest(recording(parts))
    assert not rest.stretches
    assert why in rest.note


def test_each_stretch_is_a_run_with_the_history_of_its_log() -> None:
    log, parts = resting_log(recording([(60, 'rest'), (40, 'hand'), (50, 'rest')]))
    assert [run.name for run in log.runs] == ['flight#1', 'flight#2']
    assert [part.up_axis for part in parts] == ['', '']
    assert log.started is None  # stamps count from power-on
    second = log.runs[1]
    assert second.conditions.time[0] < 2.0  # the log's first seconds are its history
    assert second.time[0] > 100.0
    assert not np.isnan(second.measured['gyroscope']).any()


@pytest.mark.shared_data
def test_false_rest_on_real_motion_is_rarer_than_stated() -> None:
    moving, false, resting, found = 0, 0, 0, 0
    for path in sorted(BROAD.glob('*.mat')):
        data = loadmat(path)
        n = len(data['imu_gyr'])
        step = 1e9 / float(data['sampling_rate'].ravel()[0])
        trial = ImuRecording(
            stamp=np.round(np.arange(n) * step).astype(np.int64),
            angular_velocity=np.ascontiguousarray(data['imu_gyr']),
            linear_acceleration=np.ascontiguousarray(data['imu_acc']),
            magnetic_field=np.full((n, 3), np.nan),
            temperature=np.full(n, 20.0),
        )
        rest = find_rest(trial)
        moves = np.add.reduceat(data['movement'].ravel().astype(float), rest.edges[:-1])
        share = moves / np.diff(rest.edges)
        moving += int((share == 1.0).sum())
        false += int(rest.windows[share == 1.0].sum())
        resting += int((share == 0.0).sum())
        found += int(rest.windows[share == 0.0].sum())
    assert moving > 1000
    assert false <= FALSE_REST * moving
    assert found >= FOUND * resting


def test_values_that_are_missing_are_no_turn() -> None:
    log = recording([(60, 'rest'), (40, 'hand'), (50, 'rest')])
    holey = log.angular_velocity.copy()
    holey[::60] = np.nan
    rest = find_rest(replace(log, angular_velocity=holey))
    assert len(rest.stretches) == 2
    assert rest.note == ''
    none = find_rest(replace(log, angular_velocity=np.full_like(holey, np.nan)))
    assert none.note.endswith('have a finite gyroscope value')
