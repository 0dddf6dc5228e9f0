# SPDX-License-Identifier: Apache-2.0
"""A user's effect file that does not load is told by file, line and reason, whatever it does."""

from pathlib import Path

import pytest
from thermal_comp.effects.user_effects import EffectError, effects_in_file

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
