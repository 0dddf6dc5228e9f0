# SPDX-License-Identifier: Apache-2.0
"""A real server and a real browser that must not ask anybody else for anything."""

from __future__ import annotations

import json
import os
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from imu_recording import ImuRecording, read_bag, write_bag

ROOT = Path(__file__).resolve().parents[2]
NAMES = (
    'chromium-headless-shell',  # first: it draws the same page with a fifth less computing
    'chromium',
    'chromium-browser',
    'google-chrome',
    'google-chrome-stable',
)
PATIENCE_MS = 240_000
"""How long the page may take on a machine that is busy."""
BAGS = [ROOT / 'bags' / f'hidden_effect_{axis}' for axis in 'xyz']
RATE = 2e-4
"""The accelerometer of the small bags follows the temperature's rate [m/s² per °C/min]."""


def chromium() -> str | None:
    """Return the browser: CHROMIUM, else one on PATH, else None for playwright's own."""
    named = os.environ.get('CHROMIUM')
    return named or next(filter(None, map(shutil.which, NAMES)), None)


class Process(Protocol):
    """What is asked of a process that runs a server."""

    def poll(self) -> int | None: ...
    def terminate(self) -> None: ...
    def kill(self) -> None: ...
    def wait(self) -> int: ...


class Forked:
    """A process that is no child of this one."""

    def __init__(self, number: int) -> None:
        self._descriptor = os.pidfd_open(number)
        self._ended = select.poll()
        self._ended.register(self._descriptor, select.POLLIN)

    def poll(self) -> int | None:
        return 0 if self._ended.poll(0) else None

    def terminate(self) -> None:
        self._send(signal.SIGTERM)

    def kill(self) -> None:
        self._send(signal.SIGKILL)

    def _send(self, number: int) -> None:
        if self.poll() is None:
            signal.pidfd_send_signal(self._descriptor, number)

    def wait(self, patience_ms: int | None = None) -> int:
        self._ended.poll(patience_ms)
        return 0


class ServerStarter:
    """Starts servers whose modules are imported already; see server_starter.py."""

    def __init__(self) -> None:
        self._folder = TemporaryDirectory(prefix='answered_')
        self._answered: dict[tuple[str, ...], Path] = {}
        self._starter = subprocess.Popen(
            [sys.executable, Path(__file__).with_name('server_starter.py')],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )

    def start(
        self, arguments: list[str], output: Path, held_by: Path | None, holds: str
    ) -> tuple[Process, str]:
        """Start one that writes to `output`; return its process and its first line."""
        os.mkfifo(output)
        held = {'held_by': held_by and str(held_by), 'holds': holds}
        process = self._fork({'arguments': arguments, 'output': str(output), **held})
        with output.open() as file:
            return process, file.readline()

    def answered(self, paths: Sequence[str | Path]) -> Path:
        """Return a folder with the cases of these bags, what is found in them included."""
        bags = tuple(map(str, paths))
        if bags not in self._answered:
            cases = Path(self._folder.name) / str(len(self._answered))
            process = self._fork({'answered': bags, 'cases': str(cases)})
            process.wait(PATIENCE_MS)
            assert process.poll() is not None, 'the bags find no answer'
            assert list(cases.glob('*/found/v1.json')), 'nothing was found in the bags'
            self._answered[bags] = cases
        return self._answered[bags]

    def _fork(self, request: dict[str, Any]) -> Forked:
        assert self._starter.stdin
        assert self._starter.stdout
        text = json.dumps({'environment': {**os.environ}, **request})
        self._starter.stdin.write(f'{text}\n')
        self._starter.stdin.flush()
        return Forked(int(self._starter.stdout.readline()))

    def end(self) -> None:
        self._starter.communicate()
        self._folder.cleanup()


@dataclass
class Server:
    """A workbench that runs."""

    address: str
    process: Process
    cases: Path

    @property
    def alive(self) -> bool:
        return self.process.poll() is None

    @property
    def port(self) -> str:
        return self.address.rpartition(':')[2].strip('/')

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


def start_command(arguments: list[str]) -> tuple[Process, str]:
    """Start the command as a user does; return its process and its first line."""
    command = [sys.executable, '-m', 'imu_workbench', *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert process.stdout
    return process, process.stdout.readline()


@contextmanager
def servers(starter: ServerStarter) -> Iterator[Callable[..., Server]]:
    """Provide a function that starts a server on a free port; end them all."""
    started: list[Process] = []
    folder = TemporaryDirectory(prefix='cases_')

    def start(
        *paths: str | Path,
        cases: Path | None = None,
        port: str = '0',
        by_command: bool = False,
        held_by: Path | None = None,
        holds: str = 'fits',
        answered: Sequence[str | Path] = (),
    ) -> Server:
        """Start one; `answered`: bags in whose cases the answer stands, found once for all tests.

        `held_by`: file that holds fits back, or figures (`holds`).
        """
        number = len(started)
        cases = cases or Path(folder.name) / str(number)
        if answered:
            shutil.copytree(starter.answered(answered), cases)
        arguments = ['serve', '--port', port, '--case', str(cases), *map(str, paths)]
        if by_command:
            process, line = start_command(arguments)
        else:
            output = Path(folder.name) / f'output_{number}'
            process, line = starter.start(arguments, output, held_by, holds)
        started.append(process)
        assert line.startswith('workbench at '), line
        return Server(line.split()[2], process, cases)

    yield start
    for process in started:
        process.terminate()
    for process in started:
        process.wait()
    folder.cleanup()


@pytest.fixture(scope='session')
def server_starter() -> Iterator[ServerStarter]:
    starter = ServerStarter()
    yield starter
    starter.end()


@pytest.fixture
def serve(server_starter: ServerStarter) -> Iterator[Callable[..., Server]]:
    """Start servers for one test, which have computed nothing yet."""
    with servers(server_starter) as start:
        yield start


@pytest.fixture(scope='session')
def hidden_effect_server(server_starter: ServerStarter) -> Iterator[Server]:
    """One server with the bags of the hidden effect for all tests that need no fresh one."""
    with servers(server_starter) as start:
        yield start(*BAGS)


@pytest.fixture(scope='session')
def small_bags(tmp_path_factory) -> Path:
    """Bags that are quick to answer for: one run of one sensor each, two devices."""
    folder = tmp_path_factory.mktemp('small')
    for name, device, seed in (
        ('dut2_x', 'dut2', 1), ('dut2_again', 'dut2', 2), ('dut7_x', 'dut7', 3),
    ):  # fmt: skip
        write_bag(small_recording(device, name, seed), folder / name)
    return folder


def small_recording(device: str, run: str, seed: int) -> ImuRecording:
    """One run of an accelerometer whose error follows the rate of its temperature."""
    recording = read_bag(BAGS[0])
    rng = np.random.default_rng(seed)
    rate = np.gradient(recording.temperature, recording.time) * 60.0
    values = np.outer(recording.temperature - 20.0, [2e-3, -1e-3, 3e-3]) + RATE * rate[:, None]
    values += [9.81, 0.0, 0.0] + rng.normal(0.0, 7e-4, values.shape)
    unknown = np.full(values.shape, np.nan)
    return replace(
        recording, linear_acceleration=values, angular_velocity=unknown, magnetic_field=unknown,
        device=device, run=run,
    )  # fmt: skip


@pytest.fixture(scope='module')
def browser() -> Iterator[Browser]:
    """A browser; its event loop ends with the file, as the tests after it run their own."""
    with sync_playwright() as playwright:
        if chromium() is None and not Path(playwright.chromium.executable_path).exists():
            pytest.fail(
                'no Chromium: "apt install chromium", or "python -m playwright install '
                '--with-deps chromium", or CHROMIUM=/path/to/chrome',
                pytrace=False,
            )
        opened = playwright.chromium.launch(
            executable_path=chromium(), args=['--no-sandbox', '--disable-gpu']
        )
        yield opened
        opened.close()


@dataclass
class Watched:
    """A page, and everything it said or asked for that it should not."""

    page: Page
    foreign: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)

    def check(self) -> None:
        assert self.foreign == []
        assert self.complaints == []


def wait_for_verdict(page) -> None:
    """Nothing on the page moves by itself any more."""
    page.locator('.verdict:not(.waiting) .sentence').wait_for()
    page.locator('.rail[aria-busy=false]').wait_for()


@contextmanager
def watching(browser: Browser) -> Iterator[Callable[..., Watched]]:
    """Provide a function that opens an address in a window of its own; close them all."""
    contexts = []

    def open_page(address: str, width: int = 1280, height: int = 800, **look: Any) -> Watched:
        context = browser.new_context(
            viewport={'width': width, 'height': height},
            accept_downloads=True,
            reduced_motion='reduce',
            **look,
        )
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        watched = Watched(page)
        own = address.split('?', maxsplit=1)[0]

        def on_request(request) -> None:
            known = (own, own.replace('http', 'ws', 1), 'data:', 'blob:')
            if not request.url.startswith(known):
                watched.foreign.append(request.url)

        page.on('request', on_request)
        page.on('websocket', on_request)
        page.on('pageerror', lambda error: watched.complaints.append(str(error)))
        page.on(
            'console',
            lambda said: said.type == 'error' and watched.complaints.append(said.text),
        )
        page.goto(address)
        return watched

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture
def watch(browser: Browser) -> Iterator[Callable[..., Watched]]:
    """Open pages for one test."""
    with watching(browser) as open_page:
        yield open_page


@pytest.fixture(scope='module')
def watch_together(browser: Browser) -> Iterator[Callable[..., Watched]]:
    """Open pages for all tests of a file: a page that is loaded anew costs seconds."""
    with watching(browser) as open_page:
        yield open_page
