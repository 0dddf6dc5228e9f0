# SPDX-License-Identifier: Apache-2.0
"""add: the effect goes where it acts, and the model before is kept."""

from __future__ import annotations

from pathlib import Path

from thermal_comp.model.file import load_model

from .asking import Answer, refuses


def test_add_places_the_effect_where_it_is_and_the_error_falls(
    bag: Path, model: Path, tmp_path: Path, answer: Answer
) -> None:
    grown = tmp_path / 'grown.yaml'
    code, content, text = answer('add', 'thermal_lag', bag, '--model', model, '-o', grown)
    assert code == 0
    (step,) = content['steps']
    assert (step['added'], step['sensor']) == ('thermal_lag', 'gyroscope')
    assert step['error_after'] < 1.2 * step['noise_floor'] < 0.5 * step['error_before']
    assert 'thermal_lag' in text
    after, before = load_model(grown), load_model(model)
    fitted = after.sensors['gyroscope'].effects[-1]
    assert abs(fitted.shape_parameters['time_constant'] - 100.0) < 10.0
    assert 'thermal_lag' not in {e.name for e in after.sensors['accelerometer'].effects}
    (kept,) = after.history
    assert kept.sensors['gyroscope'].effects == before.sensors['gyroscope'].effects


def test_a_name_that_is_no_effect_is_refused_before_anything_is_read(
    tmp_path: Path, answer: Answer
) -> None:
    out = tmp_path / 'm.yaml'
    line = refuses(answer, 'add', 'thermal_lagg', tmp_path / 'no_bag', '-o', out)
    assert "effect 'thermal_lagg' is not known (did you mean thermal_lag?); known: " in line
    assert not out.exists()


def test_mistakes_of_add_and_auto_are_one_line(
    bag: Path, model: Path, tmp_path: Path, answer: Answer
) -> None:
    out = tmp_path / 'm.yaml'
    line = refuses(answer, 'add', 'magic', bag, '-o', out)
    assert "'magic' is not known; known: bias_temperature" in line
    line = refuses(answer, 'add', 'supply_sensitivity', bag, '-o', out)
    assert 'supply_voltage, which was not logged' in line
    line = refuses(answer, 'add', 'heater_hard_iron', bag, '--sensor', 'gyroscope', '-o', out)
    assert 'heater' in line
    line = refuses(answer, 'auto', bag, '--model', tmp_path / 'none.yaml', '-o', out)
    assert 'none.yaml' in line
    assert 'no such file' in refuses(answer, 'auto', tmp_path / 'nothing', '-o', out)
    assert not out.exists()
