# SPDX-License-Identifier: Apache-2.0
"""What all tests share: shared data, golden numbers, the promise that nothing launches."""

from __future__ import annotations

import gc
import itertools
import json
import os
import sys
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # before numpy: as the command line does

import numpy as np
import pytest

os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'

WORKER = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
"""Number of this process among those of `pytest -n`."""
DOMAINS_PER_WORKER = 10
FIRST_DOMAIN = int(os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100)))
"""That of the first worker; the others inherit it in their environment."""


def domain_of_worker(number: int) -> int:
    """Return the ROS domain of this number, 0 … 9, among those of this worker."""
    return 1 + (FIRST_DOMAIN + DOMAINS_PER_WORKER * WORKER + number) % 100


if WORKER:
    os.environ['ROS_DOMAIN_ID'] = str(domain_of_worker(0))

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / 'shared'


TOGETHER = (
    ('test/imu_workbench/web/',),
    ('test/web/figures_in_browser.py', 'test/web/pictures_in_browser.py'),
)
"""Beginnings of the names of tests that share a fixture which takes long."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep in one process, with `--dist loadfile`, what is TOGETHER, too."""
    if config.getoption('dist') != 'loadfile':
        return None
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            return next((names[0] for names in TOGETHER if nodeid.startswith(names)), '') or str(
                super()._split_scope(nodeid)
            )

    return Scheduling(config, log)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption('--update-golden', action='store_true', help='rewrite test/golden')


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage in the thousands of tests and modules that stay to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # Those in a browser take longest and wait most: begun last, they would be left over alone.
    items.sort(key=lambda item: not item.path.stem.endswith('_in_browser'))
    if SHARED.is_dir():
        return
    needing = [item for item in items if item.get_closest_marker('shared_data')]
    if needing:
        config.hook.pytest_deselected(items=needing)
        items[:] = [item for item in items if item not in needing]


def pytest_deselected(items: list[pytest.Item]) -> None:
    """Count tests that are left out, by the reason."""
    for item in items:
        counts = item.config.stash.setdefault(_DESELECTED, {})
        if item.get_closest_marker('long'):
            counts[LONG] = counts.get(LONG, 0) + 1
        elif item.get_closest_marker('shared_data') and not SHARED.is_dir():
            counts[WITHOUT_SHARED] = counts.get(WITHOUT_SHARED, 0) + 1


LONG = 'make test-long runs them'
WITHOUT_SHARED = f'they need measurements in {SHARED}, which is not here'
_DESELECTED = pytest.StashKey[dict[str, int]]()
_LAUNCHED = pytest.StashKey[list[str]]()


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Take what a worker of `pytest -n` found into the summary of the whole run."""
    found = getattr(node, 'workeroutput', {})
    # Every worker collects all tests.
    node.config.stash.setdefault(_DESELECTED, {}).update(found.get('deselected', {}))
    node.config.stash.setdefault(_LAUNCHED, []).extend(found.get('launched', []))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    for reason, count in config.stash.get(_DESELECTED, {}).items():
        terminalreporter.write_line(f'{count} tests left out: {reason}')


def pytest_sessionfinish(session: pytest.Session) -> None:
    launched = [m for m in ('launch', 'launch_ros') if m in sys.modules]
    output = getattr(session.config, 'workeroutput', None)
    if output is not None:
        output['deselected'] = session.config.stash.get(_DESELECTED, {})
        output['launched'] = launched
        return
    launched = sorted({*launched, *session.config.stash.get(_LAUNCHED, [])})
    if launched:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
        print(f'\nERROR: the tests imported {launched}: bags must replay without launch')


@pytest.fixture(scope='session')
def shared() -> Path:
    """Folder with measurements by others; tests that use it carry the marker shared_data."""
    return SHARED


@pytest.fixture(scope='session')
def bags() -> Path:
    """Folder of the bags that ship."""
    return ROOT / 'bags'


@pytest.fixture(scope='session')
def ros_domains() -> Iterator[int]:
    """ROS domains that no other worker uses, for tests whose processes talk to each other."""
    return itertools.cycle([domain_of_worker(number) for number in range(1, DOMAINS_PER_WORKER)])


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Compare numbers with test/golden/NAME.json; `pytest --update-golden` rewrites the file.

    `golden(name, values, command, rtol, atol)`: `values` maps labels to numbers or lists of them,
    `command` says how a reader makes the same numbers.
    """

    def compare(
        name: str, values: dict[str, Any], command: str, *, rtol: float = 1e-6, atol: float = 0.0
    ) -> None:
        path = ROOT / 'test' / 'golden' / f'{name}.json'
        plain = {key: np.asarray(value).tolist() for key, value in values.items()}
        if request.config.getoption('--update-golden'):
            path.write_text(json.dumps({'command': command, 'values': plain}, indent=1) + '\n')
        wanted = json.loads(path.read_text())['values']
        assert sorted(wanted) == sorted(plain)
        for key, value in wanted.items():
            np.testing.assert_allclose(plain[key], value, rtol=rtol, atol=atol, err_msg=key)

    return compare


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Initialise rclpy around a test that constructs nodes in-process.

    Participants of earlier tests may still live; Fast DDS can lock up where they meet.
    """
    import rclpy

    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    rclpy.init()
    yield rclpy
    rclpy.try_shutdown()


@pytest.fixture
def ros_network() -> Any:
    """Initialise rclpy around a test whose nodes are to meet other processes."""
    import rclpy

    rclpy.init()
    yield rclpy
    rclpy.try_shutdown()
