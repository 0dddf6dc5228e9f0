# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings of every module are true."""

import doctest
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / 'src'
MODULES = sorted(
    '.'.join(path.relative_to(SRC).with_suffix('').parts[1:])
    for path in SRC.glob('*/*/**/*.py')
    if '>>> ' in path.read_text()
)


@pytest.mark.parametrize('name', MODULES)
def test_examples_are_true(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(import_module(name))
    assert result.attempted
    assert not result.failed


def test_every_package_has_examples() -> None:
    assert {name.split('.')[0] for name in MODULES} == {
        path.parent.name for path in SRC.glob('*/setup.py')
    }
