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
    'markupsafe': ('Jinja2', 'python3-jinja2'),
    'numba': ('numba', 'python3-numba'),
    'rosbags': ('rosbags', 'python3-rosbags-pip'),
    'lz4': ('lz4', 'python3-rosbags-pip'),
    'backports': ('backports.zstd', 'python3-rosbags-pip'),
    'cobs': ('cobs', 'python-cobs-pip'),
    'filterpy': ('filterpy', 'python3-filterpy-pip'),
    'plotly': ('plotly', ''),
    'GTC': ('GTC', ''),
    'allantools': ('allantools', ''),
    'weasyprint': ('weasyprint', 'python3-weasyprint-pip'),
    'lxml': ('lxml', 'python3-lxml'),
    'signxml': ('signxml', ''),
    'matplotlib': ('matplotlib', 'python3-matplotlib'),
    'nicegui': ('nicegui', ''),
    'fastapi': ('nicegui', ''),
    'uvicorn': ('nicegui', ''),
    'tsdownsample': ('tsdownsample', ''),
    'dask': ('dask', ''),
    'distributed': ('distributed', ''),
    'pyarrow': ('pyarrow', ''),
    'duckdb': ('duckdb', ''),
    'fsspec': ('fsspec', ''),
    'sklearn': ('scikit-learn', 'python3-sklearn'),
    'pymodbus': ('pymodbus', 'python3-pymodbus-pip'),
    'pymavlink': ('pymavlink', 'python3-pymavlink-pip'),
    'pyulog': ('pyulog', ''),
}
"""Import name → distribution that brings it, key of rosdep (of the distribution or of one that
requires it); '' where rosdep has none: optional. Other imports are ROS packages of that name.
"""
STANDARD = {*sys.stdlib_module_names, 'compression'}  # compression.zstd: since Python 3.14
OPTIONAL = re.compile(r'no rosdep key, pip install: (.*?)\s*-->')
"""The comment of a package.xml that lists optional libraries."""


def imports(package: Path) -> set[str]:
    """Top-level names that the package and its launch files import, its own left out."""
    return imported([*package.glob(f'{package.name}/**/*.py'), *package.glob('launch/*.py')]) - {
        package.name
    }


def imported(files: list[Path]) -> set[str]:
    """Top-level names that files import, the standard library left out."""
    names: set[str] = set()
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module.split('.')[0])
    return names - STANDARD


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_package_xml_declares_what_is_imported(package: Path) -> None:
    names = imports(package)
    text = (package / 'package.xml').read_text()
    declared = {element.text for element in ET.fromstring(text).iter('exec_depend')}  # noqa: S314
    libraries = {LIBRARIES.get(name, (name, name)) for name in names}
    assert declared == {key for _, key in libraries if key}
    comment = OPTIONAL.search(text)
    listed = set(comment[1].split(', ')) if comment else set()
    assert listed == {distribution for distribution, key in libraries if not key}


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_package_xml_declares_what_its_tests_import_of_ours(package: Path) -> None:
    """A package below imu_workbench cannot depend on it: such tests need the whole workspace."""
    ours = {path.name for path in PACKAGES} - {package.name}
    used = imported([*(ROOT / 'test' / package.name).rglob('*.py')]) & ours
    root = ET.parse(package / 'package.xml').getroot()  # noqa: S314
    declared = {e.text for kind in ('exec_depend', 'test_depend') for e in root.iter(kind)}
    above = {'imu_workbench'} if package.name != 'imu_bringup' else set()
    assert used - declared - above == set()


def test_what_a_release_asks_of_a_package() -> None:
    release = (ROOT / 'doc/release.md').read_text()
    for package in PACKAGES:
        root = ET.parse(package / 'package.xml').getroot()  # noqa: S314
        home, maintainer = root.find('url'), root.find('maintainer')
        assert home is not None
        assert home.text in release
        assert maintainer is not None
        assert maintainer.get('email', '') in release
        assert (package / 'LICENSE').read_text() == (ROOT / 'LICENSE').read_text()
        changes = (package / 'CHANGELOG.rst').read_text()
        assert f'Changelog for package {package.name}' in changes


def test_requirements_pin_every_library() -> None:
    pinned = {
        re.split(r'[=\[]', line)[0].lower()
        for path in ROOT.glob('requirements*.txt')
        for line in path.read_text().splitlines()
        if '==' in line
    }
    used = {name for package in PACKAGES for name in imports(package)} & set(LIBRARIES)
    assert not {LIBRARIES[name][0] for name in used if LIBRARIES[name][0].lower() not in pinned}
