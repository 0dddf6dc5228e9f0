# SPDX-License-Identifier: Apache-2.0
"""The layer rules: imports go downwards, peers stay apart, libraries stay at their edge."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

SRC = Path(__file__).resolve().parents[2] / 'src'
PEERS = ('imu_driver', 'thermal_comp', 'orientation_filters', 'chamber_profile')
BELOW = {
    'imu_recording': (),
    **dict.fromkeys(PEERS, ('imu_recording',)),
    'imu_workbench': ('imu_recording', *PEERS),
    'imu_bringup': ('imu_recording', *PEERS),
}
RCLPY_IN_WORKBENCH = (
    'replay.py',
    'isolated_context.py',
    'simulate/node_campaign.py',
    'web/live/listener.py',
)
LOG_LIBRARIES = ('pyulog', 'pymavlink')
EDGES = ('rclpy', 'serial', 'rosbags', 'plotly', 'nicegui', 'matplotlib', 'tsdownsample')
EDGES += LOG_LIBRARIES
FILES = sorted(
    path
    for path in SRC.glob('*/*/**/*.py')
    if path.relative_to(SRC).parts[0] == path.relative_to(SRC).parts[1]
)


def imported(path: Path) -> set[str]:
    """Top-level packages a file imports, anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split('.')[0])
    return names


def may_import(library: str, path: Path) -> bool:
    package, *rest = path.relative_to(SRC).parts[1:]
    inner = '/'.join(rest)
    if library == 'rclpy':
        return (
            path.name == 'node.py'
            or inner.endswith('_node.py')
            or inner.startswith('ros/')
            or (package == 'imu_workbench' and inner in RCLPY_IN_WORKBENCH)
        )
    if library == 'serial':
        return 'transport' in inner or inner.startswith(('chambers/', 'reference/'))
    if library in LOG_LIBRARIES:
        return package == 'imu_recording' and inner.startswith('logs/')
    if library == 'rosbags':
        return package == 'imu_recording'
    if library == 'matplotlib':
        return package == 'imu_workbench' or inner.startswith('presentation/')
    return package == 'imu_workbench'  # plotly, nicegui, tsdownsample


@pytest.mark.parametrize('path', FILES, ids=lambda path: str(path.relative_to(SRC)))
def test_imports_go_only_downwards(path: Path) -> None:
    package = path.relative_to(SRC).parts[0]
    names = imported(path)
    allowed = {package, *BELOW[package]}
    assert not (names & set(BELOW)) - allowed
    for library in EDGES:
        assert library not in names or may_import(library, path), library
    assert not names & {'launch', 'launch_ros'}


def modules_imported(path: Path) -> set[str]:
    """Dotted names of the project's modules that a file imports, anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
    return names


def test_no_module_imports_in_a_circle() -> None:
    modules = {
        '.'.join(path.relative_to(SRC).with_suffix('').parts[1:]).removesuffix('.__init__'): path
        for path in FILES
    }
    graph = {name: modules_imported(path) & modules.keys() for name, path in modules.items()}
    for face in ('imu_recording', 'thermal_comp'):
        graph[face] = set()  # they hand on names at their first use
    TopologicalSorter(graph).prepare()  # raises CycleError with the circle


STILL_MUTUAL = {('data', 'effects'), ('data', 'linear')}
"""Packages of thermal_comp that import each other: conditions are data, which operators filter and
columns describe."""


def test_packages_of_thermal_comp_import_one_way() -> None:
    root = SRC / 'thermal_comp' / 'thermal_comp'
    packages = {path.name for path in root.iterdir() if (path / '__init__.py').is_file()}
    graph: dict[str, set[str]] = {name: set() for name in packages}
    for path in root.glob('*/**/*.py'):
        body = ast.parse(path.read_text()).body
        names = {n.module for n in body if isinstance(n, ast.ImportFrom) and n.module}
        above = path.relative_to(root).parts[0]
        graph[above] |= {name.split('.')[1] for name in names if name.startswith('thermal_comp.')}
    for one, other in STILL_MUTUAL:
        assert other in graph[one]  # else strike the pair from the list
        assert one in graph[other]
        graph[one].discard(other)
    own = {name: (found & packages) - {name} for name, found in graph.items()}
    TopologicalSorter(own).prepare()  # raises CycleError with the circle


def test_nodes_that_compute_nothing_start_without_compiler_and_bag_library() -> None:
    nodes = 'chamber_profile.node, chamber_profile.reference.node, imu_driver.node'
    code = f'import sys, {nodes}; print(*{{"numba", "rosbags", "scipy"}} & sys.modules.keys())'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_there_is_something_to_check() -> None:
    assert {path.relative_to(SRC).parts[0] for path in FILES} == set(BELOW)
