# SPDX-License-Identifier: Apache-2.0
"""A user's own effect, CONTRIBUTING's example as it stands there, from check to the node."""

from __future__ import annotations

import json
import re
import textwrap
from itertools import pairwise
from pathlib import Path

import pytest
from imu_workbench.__main__ import main
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import EXAMPLE_CAMPAIGN
from thermal_comp.effects.user_effects import effects_in_file
from thermal_comp.model.file import load_model

from imu_recording import read_bag

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope='module')
def effect(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, copied into a file."""
    text = (ROOT / 'CONTRIBUTING.md').read_text('utf-8')
    found = re.search(r'```python\n(.*?)```', text, re.DOTALL)
    assert found
    file = tmp_path_factory.mktemp('own') / 'my_effect.py'
    file.write_text(textwrap.dedent(found.group(1)))
    return file


def test_the_example_keeps_the_contract(effect: Path) -> None:
    assert main(['check-effect', str(effect)]) == 0


def test_a_search_steps_no_further_than_the_effect_is_wide(effect: Path) -> None:
    (kind,) = effects_in_file(effect)
    forms = [candidate.effect for candidate in kind.search_grid(EXAMPLE_CAMPAIGN)]
    centres = sorted(form.shape_parameters['centre'] for form in forms)
    assert (centres[0], centres[-1]) == (-10.0, 50.0)
    assert max(b - a for a, b in pairwise(centres)) < 3.0


def test_it_is_hidden_found_added_and_used(
    effect: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ['--effects', str(effect)]
    campaign, model = tmp_path / 'campaign', tmp_path / 'model.yaml'
    hide = ['--hide', 'activity_dip', '--rate', '0.02', '--seed', '3', '-o', str(campaign)]
    assert main(['simulate', 'paper_betta2022', *hide, *own]) == 0
    hidden = json.loads((campaign / '.truth.json').read_text())['parameters']['centre']
    assert main(['reveal', str(campaign)]) == 2
    assert 'give its file with --effects' in capsys.readouterr().err
    bags = [str(campaign / axis) for axis in 'xyz']
    assert main(['add', 'activity_dip', *bags, *own, '-o', str(model)]) == 0
    catalogue = {kind.name: kind for kind in effects_in_file(effect)}
    loaded = load_model(model, {**EFFECTS, **catalogue})
    found = loaded.sensors['gyroscope'].effects[1]
    assert found.shape_parameters['centre'] == pytest.approx(hidden, abs=1.0)
    capsys.readouterr()
    out = tmp_path / 'out'
    use = [
        ['compare', *bags, '--model', str(model)],
        ['apply', bags[0], '--model', str(model), '-o', str(out)],
    ]
    for argv in use:
        assert main(argv) == 2
        told = capsys.readouterr().err
        assert 'activity_dip' in told
        assert 'give its file my_effect.py with --effects (a node: parameter effects)' in told
        assert main([*argv, *own]) == 0
    assert read_bag(out).compensated
    node = ['-p', f'model:={model}', '-p', f'effects:=[{effect}]', '-o', str(tmp_path / 'node')]
    assert main(['replay', bags[0], '--node', 'thermal_comp', *node]) == 0
    node = ['-p', f'model:={model}', *own, '-o', str(tmp_path / 'told')]
    assert main(['replay', bags[0], '--node', 'thermal_comp', *node]) == 0

    # Another version of the file is not what the model was fitted with.
    capsys.readouterr()
    other = tmp_path / 'my_effect.py'
    other.write_text(effect.read_text().replace('3.0', '5.0'))
    assert main(['compare', *bags, '--model', str(model), '--effects', str(other)]) == 2
    assert 'fitted with another version of my_effect.py' in capsys.readouterr().err


def test_an_effect_that_raises_is_told_by_its_own_line(
    effect: Path, bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'faulty.py'
    faulty = effect.read_text().replace(
        '        return np.exp', '        1 / 0\n        return np.exp'
    )
    file.write_text(faulty)
    line = faulty.splitlines().index('        1 / 0') + 1
    assert main(['check-effect', str(file)]) == 3
    assert f'raises ZeroDivisionError: division by zero (faulty.py, line {line})' in (
        capsys.readouterr().out
    )
    file.write_text(faulty.replace('1 / 0', 'raise SystemExit(7)'))
    assert main(['check-effect', str(file)]) == 3
    assert f'raises SystemExit: 7 (faulty.py, line {line})' in capsys.readouterr().out
    # One that fails on real runs only.
    late = effect.read_text().replace(
        '        return np.exp',
        '        if len(conditions) > 2000:\n            1 / 0\n        return np.exp',
    )
    file.write_text(late)
    argv = ['add', 'activity_dip', str(bags / 'dut1_x'), '--effects', str(file)]
    assert main([*argv, '-o', str(tmp_path / 'm.yaml')]) == 2
    told = capsys.readouterr().err
    assert told.count('\n') == 1
    assert 'an effect raises ZeroDivisionError: division by zero (faulty.py, line' in told
