# SPDX-License-Identifier: Apache-2.0
"""A user's effect file that does not load is told by file, line and reason, whatever it does."""

import inspect
import shutil
from pathlib import Path

import pytest
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.user_effects import EffectError, effect_catalogue, effects_in_file

FAULTS = {
    'class X(:\n': 'line 1: cannot be loaded: invalid syntax',
    '\n\nx = 1 / 0\n': 'line 3: cannot be loaded: ZeroDivisionError',
    'import no_such_module\n': 'line 1: cannot be loaded: ModuleNotFoundError',
    'import sys\nsys.exit(3)\n': 'line 2: cannot be loaded: SystemExit',
    'def f():\n    raise KeyError("k")\nf()\n': 'line 2: cannot be loaded: KeyError',
    'x = 1\n': 'defines no subclass',
}


@pytest.mark.parametrize('text', FAULTS)
def test_a_faulty_file_is_told_by_line_and_reason(text: str, tmp_path: Path) -> None:
    path = tmp_path / 'mine.py'
    path.write_text(text)
    with pytest.raises(EffectError) as refused:
        effects_in_file(path)
    assert str(path) in str(refused.value)
    assert FAULTS[text] in str(refused.value)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(EffectError, match='no such file'):
        effects_in_file(tmp_path / 'absent.py')


@pytest.mark.parametrize('name', sorted(EFFECTS))
def test_a_copy_of_a_file_of_the_catalogue_loads_and_is_welcome(name: str, tmp_path: Path) -> None:
    path = Path(shutil.copy(inspect.getfile(EFFECTS[name]), tmp_path))
    (effect,) = effects_in_file(path)
    assert effect.name == name
    assert effect() is not None
    assert set(effect_catalogue([path])) >= set(EFFECTS)


def test_a_name_is_given_once(tmp_path: Path) -> None:
    path = Path(shutil.copy(inspect.getfile(EFFECTS['thermal_lag']), tmp_path))
    path.write_text(path.read_text('utf-8').replace('(T_lag − T)', 'T_lag'), 'utf-8')
    with pytest.raises(EffectError, match="'thermal_lag' is in the catalogue already"):
        effect_catalogue([path])
    mine, other = tmp_path / 'a' / 'mine.py', tmp_path / 'b' / 'mine.py'
    for file, factor in ((mine, '1.0'), (other, '2.0')):
        file.parent.mkdir()
        text = path.read_text('utf-8').replace("'thermal_lag'", "'my_lag'", 1)
        file.write_text(f'{text}\nFACTOR = {factor}\n', 'utf-8')
    assert 'my_lag' in effect_catalogue([mine, mine])
    with pytest.raises(EffectError, match="'my_lag' is in the catalogue already"):
        effect_catalogue([mine, other])
