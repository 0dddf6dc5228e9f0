# SPDX-License-Identifier: Apache-2.0
"""auto: effects are added until nothing is missing; what was left out is told."""

from dataclasses import replace
from pathlib import Path

from imu_workbench.commands.auto import defect_lines
from thermal_comp.data.quality import check_quality
from thermal_comp.model.file import load_model

from imu_recording import read_bag

from .asking import Answer


def test_auto_adds_until_nothing_is_missing(bag: Path, tmp_path: Path, answer: Answer) -> None:
    target = tmp_path / 'auto.yaml'
    code, content, _ = answer('auto', bag, '-o', target)
    assert code == 0
    assert content['steps']
    first = content['steps'][0]
    assert set(first) >= {'added', 'error_before', 'error_after', 'noise_floor'}
    assert first['error_after'] < first['error_before']
    named = {first['added'], *first['ambiguous_with']}
    assert named & {'thermal_lag', 'thermal_lag_two_stage'}
    assert content['verdict'] in ('complete', 'ambiguous')
    held = {effect.name for effect in load_model(target).sensors['gyroscope'].effects}
    assert first['added'] in held


def test_auto_says_what_it_left_out_and_why(bag: Path) -> None:
    recording = read_bag(bag)
    in_g = replace(recording, linear_acceleration=recording.linear_acceleration / 9.80665)
    first, *why = defect_lines(check_quality([in_g])[1])
    assert first.endswith('left out of what follows: unit_mismatch (accelerometer)')
    assert why[0].endswith('as if in g')
    assert not defect_lines(check_quality([recording])[1])
