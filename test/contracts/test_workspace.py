# SPDX-License-Identifier: Apache-2.0
"""The workspace as its user meets it: packages, executables, launch files, licence headers."""

import os
import re
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in ROOT.glob('src/*/package.xml'))
NODES = {
    'imu_recording': ['recorder_node'],
    'imu_driver': ['imu_driver_node'],
    'thermal_comp': ['thermal_comp_node'],
    'orientation_filters': ['complementary_filter_node', 'ahrs_filter_node'],
    'chamber_profile': ['chamber_profile_node', 'reference_logger_node'],
    'imu_bringup': ['imu_chain_node'],
}


def test_colcon_sees_seven_ament_python_packages() -> None:
    listed = subprocess.run(
        [str(Path(sys.executable).parent / 'colcon'), 'list', '--base-paths', 'src'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    kinds = {line.split('\t')[0]: line.split('\t')[2] for line in listed.splitlines()}
    assert kinds == dict.fromkeys(PACKAGES, '(ros.ament_python)')
    assert len(PACKAGES) == 7


@pytest.mark.parametrize('package', PACKAGES)
def test_every_executable_is_installed_where_ros2_run_looks(package: str) -> None:
    scripts = [
        script.name
        for script in entry_points(group='console_scripts')
        if script.value.startswith(f'{package}.')
    ]
    folder = ROOT / 'install' / package / 'lib' / package
    for name in (*scripts, *NODES.get(package, [])):
        assert os.access(folder / name, os.X_OK), name


@pytest.mark.parametrize('package', sorted(NODES))
def test_every_node_has_a_launch_file_and_parameters(package: str) -> None:
    launches = list((ROOT / 'src' / package / 'launch').glob('*.launch.py'))
    configs = list((ROOT / 'src' / package / 'config').glob('*.yaml'))
    assert launches
    assert configs
    for path in launches:
        compile(path.read_text(), str(path), 'exec')
    for path in configs:
        content = yaml.safe_load(path.read_text())
        assert all('ros__parameters' in section for section in content.values()), path
    named = ''.join(path.read_text() for path in launches)
    for node in NODES[package]:
        assert node in named, f'no launch file of {package} starts {node}'


def tracked(*suffixes: str) -> list[Path]:
    listed = subprocess.run(
        ['git', 'ls-files', '-co', '--exclude-standard'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    return [ROOT / name for name in listed.splitlines() if name.endswith(suffixes)]


def test_every_source_file_names_its_licence() -> None:
    missing = [
        path.relative_to(ROOT)
        for path in tracked('.py', '.sh', '.c', '.h')
        if path.exists() and 'SPDX-License-Identifier: Apache-2.0' not in path.read_text()[:200]
    ]
    assert not missing


LAUNCHING = re.compile(r'^from (launch|launch_ros|ament_index_python)\b', re.MULTILINE)


def test_package_dependencies_cover_the_imports() -> None:
    messages = re.compile(r'^\s*from (\w+_(?:msgs|srvs))(?:\.\w+)? import', re.MULTILINE)
    for package in PACKAGES:
        declared = (ROOT / 'src' / package / 'package.xml').read_text()
        for path in (ROOT / 'src' / package / package).rglob('*.py'):
            for name in set(messages.findall(path.read_text())):
                assert f'>{name}<' in declared, f'{path} imports {name}'
        for path in (ROOT / 'src' / package / 'launch').glob('*.launch.py'):
            for name in set(LAUNCHING.findall(path.read_text())):
                assert f'>{name}<' in declared, f'{path} imports {name}'


def test_readme_says_how_to_run_every_node() -> None:
    readme = (ROOT / 'README.md').read_text()
    for package, nodes in NODES.items():
        for node in nodes:
            assert f'ros2 run {package} {node}' in readme


@pytest.mark.parametrize('shell', ['bash -c', 'bash -uc', 'bash -ec'])
def test_environment_file_can_be_sourced(shell: str) -> None:
    command = '. ./env.sh && . ./env.sh && python -c "import rclpy, imu_workbench"'
    done = subprocess.run(
        [*shell.split(), command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr


def test_all_packages_are_of_one_version() -> None:
    stated = {
        found
        for package in PACKAGES
        for file, form in (
            ('setup.py', r"version='([\d.]+)'"),
            ('package.xml', r'<version>([\d.]+)<'),
        )
        for found in re.findall(form, (ROOT / 'src' / package / file).read_text())
    }
    assert len(stated) == 1
    assert f'## {stated.pop()} ' in (ROOT / 'CHANGELOG.md').read_text()


NAMED_FILE = re.compile(r'`([\w./-]+\.(?:py|sh|yaml|md|toml))`')
MADE_BY_USERS = {'metadata.yaml', 'my_effect.py'}


def test_files_that_documents_name_exist() -> None:
    present = [f'/{path.relative_to(ROOT)}' for path in tracked('') if path.exists()]
    missing = [
        f'{document.relative_to(ROOT)}: {name}'
        for document in tracked('.md')
        for name in NAMED_FILE.findall(document.read_text())
        if Path(name).name not in MADE_BY_USERS
        and not any(path.endswith(f'/{name.removeprefix("../")}') for path in present)
    ]
    assert not missing
