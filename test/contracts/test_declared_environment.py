# SPDX-License-Identifier: Apache-2.0
"""With nothing but what its package.xml declares every executable of a package starts."""

from __future__ import annotations

import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from importlib.metadata import PackageNotFoundError, entry_points, requires
from pathlib import Path

import pytest
from ament_index_python.packages import PackageNotFoundError as NoRosPackageError
from ament_index_python.packages import get_package_share_directory, get_packages_with_prefixes

from .test_dependencies import LIBRARIES, PACKAGES, ROOT

OWN = {package.name for package in PACKAGES}
EXECUTABLES = sorted(
    (entry.value.partition('.')[0], entry.name, entry.value)
    for entry in entry_points(group='console_scripts')
    if entry.value.partition('.')[0] in OWN - {'imu_workbench'}
) + [('imu_workbench', 'imu_workbench', 'imu_workbench.__main__:main')]
START = """
import sys
from importlib import import_module

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {absent!r}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)

sys.meta_path.insert(0, Absent())
{before}
"""
HELP = """
sys.argv = [{name!r}, '--help']
sys.exit(getattr(import_module({module!r}), {function!r})())
"""


def declared(name: str) -> set[str]:
    """Return what a package depends on, all the way down: ROS packages and keys of rosdep."""
    found: set[str] = set()
    waiting = [name]
    while waiting:
        package = waiting.pop()
        if package in found:
            continue
        found.add(package)
        file = ROOT / 'src' / package / 'package.xml'
        if package not in OWN:
            try:
                file = Path(get_package_share_directory(package)) / 'package.xml'
            except NoRosPackageError:  # a key of rosdep, or not installed here
                continue
        root = ET.parse(file).getroot()  # noqa: S314
        waiting += [d.text or '' for tag in ('exec_depend', 'depend') for d in root.iter(tag)]
    return found


def brought(distributions: set[str]) -> set[str]:
    """Return the distributions and what they require, all the way down, in lower case."""
    found: set[str] = set()
    waiting = list(distributions)
    while waiting:
        name = waiting.pop().lower()
        if name in found:
            continue
        found.add(name)
        try:
            wanted = requires(name) or []
        except PackageNotFoundError:
            continue
        waiting += [re.split(r'[^\w.-]', w)[0] for w in wanted if 'extra ==' not in w]
    return found


def absent(package: str) -> set[str]:
    """Return the import names that an environment made from package.xml does not have."""
    known = declared(package)
    present = brought({dist for dist, key in LIBRARIES.values() if key in known})
    libraries = {name for name, (dist, _) in LIBRARIES.items() if dist.lower() not in present}
    messages = {p for p in get_packages_with_prefixes() if p.endswith(('_msgs', '_srvs'))}
    return libraries | (messages | OWN) - known


def run(package: str, code: str) -> subprocess.CompletedProcess[str]:
    script = START.format(absent=absent(package), before=code)
    return subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.parametrize(('package', 'name', 'value'), EXECUTABLES, ids=lambda text: text)
def test_it_starts_with_what_is_declared(package: str, name: str, value: str) -> None:
    module, _, function = value.partition(':')
    done = run(package, HELP.format(name=name, module=module, function=function))
    assert done.returncode == 0, done.stderr
    assert 'usage' in done.stdout.lower()


def test_what_is_absent_is_absent() -> None:
    assert {'scipy', 'rosbags', 'filterpy'} & absent('imu_driver') == {'filterpy'}
    assert {'thermal_comp', 'geometry_msgs', 'pymodbus'} & absent('orientation_filters') == {
        'thermal_comp',
        'pymodbus',
    }
    done = run('imu_driver', 'import filterpy')
    assert 'ModuleNotFoundError' in done.stderr


def test_an_optional_library_that_is_missing_is_named() -> None:
    done = run(
        'imu_recording',
        'from pathlib import Path\n'
        'from imu_recording.logs.ulog import _opened\n'
        '_opened(Path("flight.ulg"), header_only=True)',
    )
    assert 'reading a ULog needs pyulog (pip install pyulog)' in done.stderr


def test_a_verb_whose_library_is_missing_says_so() -> None:
    code = "from imu_workbench.__main__ import main; sys.exit(main(['report', '--help']))"
    done = run('imu_workbench', code)
    assert done.returncode == 2
    line = 'report: needs allantools, which is not installed (pip install allantools)'
    assert done.stderr.splitlines() == [line]
