# SPDX-License-Identifier: Apache-2.0
"""fit: the model holds what was put in; harm, pooling and several devices are told."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.__main__ import main
from imu_workbench.answer import CHECK_FAILED
from thermal_comp.model.bounds import LARGEST_ERROR
from thermal_comp.model.file import load_model

from imu_recording import write_bag


def test_fit_saves_what_it_says(device_bags: Path, tmp_path: Path) -> None:
    answer, target = tmp_path / 'fit.json', tmp_path / 'm.yaml'
    assert main(['fit', str(device_bags / 'dut1'), '-o', str(target), '--json', str(answer)]) == 0
    content = json.loads(answer.read_text())
    assert content['schema'] == 1
    assert content['device'] == 'dut1'
    part = content['sensors']['gyroscope']
    assert part['unit'] == 'rad/s'
    for name in ('measured_rms', 'residual_rms', 'held_out_rms', 'noise_floor'):
        assert len(part[name]) == 3
    slope = load_model(target).sensors['gyroscope'].coefficients[0][0]
    np.testing.assert_allclose(slope, [4e-5, -2e-5, 1e-5], atol=1e-6)


def test_a_model_that_held_out_parts_speak_against_is_saved_by_force_alone(
    run, tmp_path: Path, capsys
) -> None:
    """A slope that turns its sign from cycle to cycle: a line does harm on the one left out."""
    recording = run('dut1', 'z', cycles=4)
    sign = np.where(recording.cycle % 2 == 1, 1.0, -1.0) * (recording.cycle > 0)
    swing = (sign * (recording.temperature - 22.5))[:, None] * 1e-3
    write_bag(
        replace(recording, angular_velocity=recording.angular_velocity + swing), tmp_path / 'bag'
    )
    target, answer = tmp_path / 'm.yaml', tmp_path / 'a.json'
    argv = ['fit', str(tmp_path / 'bag'), '-o', str(target)]
    assert main([*argv, '--json', str(answer)]) == CHECK_FAILED
    (line,) = (t for t in capsys.readouterr().out.splitlines() if t.startswith('not saved'))
    assert 'gyroscope x: the error on held-out parts is' in line
    assert '--force saves it' in line
    assert not target.exists()
    assert json.loads(answer.read_text())['model'] is None
    assert main([*argv, '--force']) == 0
    assert load_model(target).device == 'dut1'


def test_a_reference_temperature_that_was_not_recorded_is_said(
    run, tmp_path: Path, capsys
) -> None:
    recording = run('dut1', 'z', cycles=2)
    for name, warmer in (('cold', 0.0), ('hot', 60.0 - recording.temperature.min())):
        write_bag(replace(recording, temperature=recording.temperature + warmer), tmp_path / name)
        assert main(['fit', str(tmp_path / name), '-o', str(tmp_path / f'{name}.yaml')]) == 0
    cold, hot = (t for t in capsys.readouterr().out.splitlines() if t.startswith('saved'))
    assert 'outside' not in cold
    assert 'at 20 °C, 40.0 K outside that' in hot


def test_what_was_fitted_is_shown_where_no_sensor_can_have_it(
    device_bags: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LARGEST_ERROR, 'gyroscope', 1e-6)
    target = tmp_path / 'm.yaml'
    assert main(['fit', str(device_bags / 'dut1'), '-o', str(target)]) == CHECK_FAILED
    said = capsys.readouterr().out
    assert 'held out' in said
    assert 'the model is not saved: sensors.gyroscope' in said
    assert not target.exists()


def test_pooling_is_refuted_by_opposite_slopes(device_bags: Path, tmp_path: Path, capsys) -> None:
    bags = [str(device_bags / 'dut1'), str(device_bags / 'dut2')]
    assert main(['fit', *bags, '-o', str(tmp_path / 'm.yaml')]) == 2
    assert '--pooled' in capsys.readouterr().err
    answer = tmp_path / 'a.json'
    argv = ['fit', *bags, '--pooled', '-o', str(tmp_path / 'm.yaml'), '--json', str(answer)]
    assert main(argv) == 0
    assert 'one model cannot hold for all' in capsys.readouterr().out
    tests = json.loads(answer.read_text())['pooling']
    for test in tests.values():
        assert test['opposite_signs'] == [True, True, True]
        assert np.min(np.divide(test['pooled_rms'], test['own_rms'])) > 1.5


def test_several_devices_in_one_bag(device_bags: Path, tmp_path: Path, capsys) -> None:
    both, target = str(device_bags / 'both'), tmp_path / 'm.yaml'
    assert main(['fit', both, '-o', str(target)]) == 2
    assert '/dut1, /dut2' in capsys.readouterr().err
    assert main(['fit', both, '--namespace', '/dut2', '-o', str(target)]) == 0
    assert load_model(target).device == 'dut2'
    page, answer = tmp_path / 'r.html', tmp_path / 'r.json'
    argv = ['report', both, '--no-attitude', '--no-diagnosis', '-o', str(page)]
    assert main([*argv, '--json', str(answer)]) == 0
    content = json.loads(answer.read_text())
    assert [d['name'] for d in content['devices']] == ['dut1', 'dut2']
    assert page.read_text('utf-8').startswith('<!DOCTYPE html>')
