# SPDX-License-Identifier: Apache-2.0
"""What a user can mend is a UserError; a plain ValueError would end a command as a bug."""

import ast
from functools import lru_cache
from pathlib import Path

import pytest

SRC = Path(__file__).resolve().parents[2] / 'src'
CAUGHT_INSIDE = {
    'ClockError', 'FrameError', 'ModbusError', 'ModbusRefusalError', 'DecodeError',
    'UserError',
}  # fmt: skip
"""Errors of a protocol or a message; whoever calls the function that raises them handles them."""
PARSERS = {'compression.py', 'ascii.py', 'sample_bytes.py', 'document.py'}
"""Files whose ValueError says that bytes or a field cannot be read; their callers say where."""
FILES = sorted(SRC.glob('*/*/**/*.py'))


@lru_cache(maxsize=1)
def nodes_of(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse(path.read_text())))


def names_of(path: Path, kind: type[ast.AST]) -> list[ast.AST]:
    return [node for node in nodes_of(path) if isinstance(node, kind)]


@pytest.mark.parametrize('package', sorted({path.relative_to(SRC).parts[0] for path in FILES}))
def test_mistakes_of_users_have_one_root(package: str) -> None:
    wrong = []
    for path in (p for p in FILES if p.relative_to(SRC).parts[0] == package):
        wrong += [
            f'{path.name}: {node.name}'
            for node in names_of(path, ast.ClassDef)
            if any(getattr(base, 'id', '') == 'ValueError' for base in node.bases)
            and node.name not in CAUGHT_INSIDE
        ]
        if path.name not in PARSERS:
            wrong += [
                f'{path.name}:{node.lineno}'
                for node in names_of(path, ast.Raise)
                if isinstance(node.exc, ast.Call)
                and getattr(node.exc.func, 'id', '') == 'ValueError'
            ]
    assert not wrong
