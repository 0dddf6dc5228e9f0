# SPDX-License-Identifier: Apache-2.0
"""What a benchmark imports from the packages exists there, after a rename as well."""

from __future__ import annotations

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = {path.parent.name for path in ROOT.glob('src/*/package.xml')}


@pytest.mark.parametrize('path', sorted(ROOT.glob('benchmarks/*.py')), ids=lambda path: path.stem)
def test_every_imported_name_exists(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ImportFrom) and (node.module or '').split('.')[0] in PACKAGES:
            module = import_module(str(node.module))
            for name in (item.name for item in node.names):
                assert hasattr(module, name) or find_spec(f'{node.module}.{name}'), name
