# SPDX-License-Identifier: Apache-2.0
"""The Python face: results print, show and draw themselves; its example is run with all others."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from imu_recording.user_error import UserError
from thermal_comp.effects import EFFECTS

import thermal_comp as tc
from imu_recording import ImuRecording

from .campaign import run


@pytest.fixture(scope='module')
def recordings() -> list[ImuRecording]:
    return [run(up, seed=k, cycles=2, period=20.0) for k, up in enumerate(('+x', '+z'))]


@pytest.fixture(scope='module')
def results(recordings: list[ImuRecording]) -> dict[str, Any]:
    model = tc.fit(recordings)
    return {
        'model': model,
        'comparison': tc.compare(recordings, model),
        'diagnosis': tc.diagnose(recordings, model),
        'growth': tc.add(recordings, 'thermal_lag', sensors=['accelerometer']),
    }


def test_importing_the_package_imports_no_numerics() -> None:
    code = 'import sys, thermal_comp; print(*{"numpy", "numba", "scipy"} & sys.modules.keys())'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
    assert set(tc.__all__) <= set(dir(tc))
    with pytest.raises(AttributeError, match='no attribute'):
        _ = tc.guess


@pytest.mark.parametrize('name', ['model', 'comparison', 'diagnosis', 'growth'])
def test_results_print_show_and_draw_themselves(results: dict[str, Any], name: str) -> None:
    result = results[name]
    lines = repr(result).splitlines()
    assert len(lines) >= 3
    assert any('accelerometer' in line for line in lines)
    page = result._repr_html_()
    assert page.count('<tr>') >= 2
    assert len(re.findall('<td>', page)) % len(re.findall('<th>', page)) == 0
    assert isinstance(result.to_dict(), dict)
    figure = result.plot()
    assert figure._repr_png_().startswith(b'\x89PNG')
    drawn = [panel for panel in figure.axes if panel.patches or panel.lines]
    assert drawn
    assert all(panel.get_ylabel().endswith(']') for panel in drawn)


def test_the_line_is_what_fit_fits(results: dict[str, Any]) -> None:
    effects = {s: [e.name for e in m.effects] for s, m in results['model'].sensors.items()}
    assert all(names == ['bias_temperature'] for names in effects.values())
    assert 'bias_temperature' in repr(results['model'])


def test_a_saved_model_comes_back(results: dict[str, Any], tmp_path: Path) -> None:
    tc.save(results['growth'], tmp_path / 'grown.yaml')
    back = tc.load(tmp_path / 'grown.yaml')
    assert back.to_dict() == results['growth'].model.to_dict()


def test_one_recording_is_compensated_to_one_and_several_to_a_list(
    recordings: list[ImuRecording], results: dict[str, Any]
) -> None:
    model = results['model']
    alone = tc.compensate(recordings[0], model)
    spread = (recordings[0].linear_acceleration.std(), alone.linear_acceleration.std())
    assert spread[1] < spread[0]
    assert len(tc.compensate(recordings, model)) == len(recordings)


def test_effects_may_be_names_classes_or_values(recordings: list[ImuRecording]) -> None:
    lag = EFFECTS['thermal_lag']
    for given in (['bias_temperature', lag], ['bias_temperature', lag(time_constant=100.0)]):
        model = tc.fit(recordings, {'accelerometer': given})
        names = [effect.name for effect in model.sensors['accelerometer'].effects]
        assert names == ['bias_temperature', 'thermal_lag']


def test_fit_takes_names_from_the_catalogue_it_is_given(recordings: list[ImuRecording]) -> None:
    own = type('OwnLag', (EFFECTS['thermal_lag'],), {'name': 'own_lag'})
    catalogue = {**EFFECTS, 'own_lag': own}
    names = ['bias_temperature', 'own_lag']
    for given in (names, {'accelerometer': names}):
        model = tc.fit(recordings, given, catalogue=catalogue)
        assert [type(e) for e in model.sensors['accelerometer'].effects][1] is own
    with pytest.raises(UserError, match="'own_lag' is not known"):
        tc.fit(recordings, names)


def test_bags_are_read_by_path_and_by_glob(bags: Path) -> None:
    one, *_ = tc.read(bags / 'hidden_effect_x')
    three = tc.read(str(bags / 'hidden_effect_?'))
    assert [r.up_axis for r in three] == ['+x', '+y', '+z']
    assert re.fullmatch(
        r'ImuRecording\(dut2, \S+, \+x up: \d+ samples at [\d.]+ Hz, [\d.]+ h, die .+ °C; .+\)',
        repr(one),
    )


def test_a_recording_of_a_moving_device_says_so(bags: Path) -> None:
    moving, still = tc.read(bags / 'dut1_motion', bags / 'dut1_x')
    assert [note.startswith('the device moves in') for note in moving.notes].count(True) == 1
    assert not any('moves' in note for note in still.notes)


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (lambda runs, *_: tc.read(), 'no bag given'),
        (lambda runs, folder, _: tc.read(folder / 'nothing_?'), 'no bag matches'),
        (lambda runs, folder, _: tc.read(folder / 'nothing'), 'nothing'),
        (lambda runs, *_: tc.fit(runs, 'thermal_leg'), "'thermal_leg' is not known"),
        (lambda runs, *_: tc.add(runs, 'thermal_leg'), "'thermal_leg' is not known"),
        (lambda runs, _, results: tc.add(runs, results['diagnosis']), 'names no effect'),
        (lambda runs, *_: tc.fit([]), 'no recordings'),
        (lambda runs, _, results: tc.compare(results['model'], runs), 'they come first'),
        (lambda runs, _, results: tc.compensate(results['model'], runs), 'they come first'),
    ],
)
def test_a_mistake_is_one_message(
    recordings: list[ImuRecording],
    results: dict[str, Any],
    tmp_path: Path,
    call: Any,
    message: str,
) -> None:
    with pytest.raises(UserError, match=message):
        call(recordings, tmp_path, results)


def test_a_picture_without_matplotlib_says_what_to_install(
    results: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, 'thermal_comp.presentation.picture', raising=False)
    monkeypatch.setitem(sys.modules, 'matplotlib.figure', None)
    with pytest.raises(UserError, match='pip install matplotlib'):
        results['model'].plot()
