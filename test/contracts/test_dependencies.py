# SPDX-License-Identifier: Apache-2.0
"""What a package imports is what its package.xml declares, and requirements*.txt pins."""

from __future__ import annotations

import ast
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent for path in ROOT.glob('src/*/package.xml'))
LIBRARIES = {
    'numpy': ('numpy', 'python3-numpy'),
    'scipy': ('scipy', 'python3-scipy'),
    'yaml': ('PyYAML', 'python3-yaml'),
    'jsonschema': ('jsonschema', 'python3-jsonschema'),
    'serial': ('pyserial', 'python3-serial'),
    'jinja2': ('Jinja2', 'python3-jinja2'),
    'markupsafe': ('Jinja2', 'python3-markupsafe'),
    'numba': ('numba', ''),
    'rosbags': ('rosbags', ''),
    'lz4': ('lz4', ''),
    'backports': ('backports.zstd', ''),
    'cobs': ('cobs', ''),
    'filterpy': ('filterpy', ''),
    'plotly': ('plotly', ''),
    'GTC': ('GTC', ''),
    'allantools': ('allantools', ''),
    'weasyprint': ('weasyprint', ''),
    'lxml': ('lxml', ''),
    'signxml': ('signxml', ''),
    'matplotlib': ('matplotlib', ''),
    'nicegui': ('nicegui', ''),
    'fastapi': ('nicegui', ''),
    'uvicorn': ('nicegui', ''),
    'tsdownsample': ('tsdownsample', ''),
    'dask': ('dask', ''),
    'distributed': ('distributed', ''),
    'pyarrow': ('pyarrow', ''),
    'duckdb': ('duckdb', ''),
    'fsspec': ('fsspec', ''),
    'sklearn': ('scikit-learn', ''),
    'pymodbus': ('pymodbus', ''),
    'pymavlink': ('pymavlink', ''),
    'pyulog': ('pyulog', ''),
}
"""Import name → distribution that brings it, rosdep key.

No key: apt has none or none new enough, or the library is optional. Every other import is a ROS
package of that name.
"""
STANDARD = {*sys.stdlib_module_names, 'compression'}  # compression.zstd: since Python 3.14
PIP = re.compile(r'from requirements\*\.txt: (.*?)\s*-->')
"""The comment of a package.xml that lists what comes from no apt package."""


def imports(package: Path) -> set[str]:
    """Top-level names that the package and its launch files import, its own left out."""
    names: set[str] = set()
    for path in [*package.glob(f'{package.name}/**/*.py'), *package.glob('launch/*.py')]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module.split('.')[0])
    return names - STANDARD - {package.name}


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_package_xml_declares_what_is_imported(package: Path) -> None:
    names = imports(package)
    text = (package / 'package.xml').read_text()
    declared = {element.text for element in ET.fromstring(text).iter('exec_depend')}  # noqa: S314
    libraries = {LIBRARIES.get(name, (name, name)) for name in names}
    assert declared == {key for _, key in libraries if key}
    comment = PIP.search(text)
    listed = set(comment[1].split(', ')) if comment else set()
    assert listed == {distribution for distribution, key in libraries if not key}


def test_requirements_pin_every_library() -> None:
    pinned = {
        re.split(r'[=\[]', line)[0].lower()
        for path in ROOT.glob('requirements*.txt')
        for line in path.read_text().splitlines()
        if '==' in line
    }
    used = {name for package in PACKAGES for name in imports(package)} & set(LIBRARIES)
    assert not {LIBRARIES[name][0] for name in used if LIBRARIES[name][0].lower() not in pinned}
