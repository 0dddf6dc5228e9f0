# SPDX-License-Identifier: Apache-2.0
"""A real server and a real browser that must not ask anybody else for anything."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from imu_recording import ImuRecording, read_bag, write_bag

ROOT = Path(__file__).resolve().parents[2]
NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
PATIENCE_MS = 240_000
"""How long the page may take on a machine that is busy."""
BAGS = [ROOT / 'bags' / f'hidden_effect_{axis}' for axis in 'xyz']
RATE = 2e-4
"""The accelerometer of the small bags follows the temperature's rate [m/s² per °C/min]."""


def chromium() -> str | None:
    """Return the browser: CHROMIUM, else one on PATH, else None for playwright's own."""
    named = os.environ.get('CHROMIUM')
    return named or next(filter(None, map(shutil.which, NAMES)), None)


@dataclass
class Server:
    """A workbench that runs."""

    address: str
    process: subprocess.Popen[str]
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


@contextmanager
def servers() -> Iterator[Callable[..., Server]]:
    """Provide a function that starts a server on a free port; end them all."""
    started: list[subprocess.Popen[str]] = []
    folder = TemporaryDirectory(prefix='cases_')

    def start(*arguments: str | Path, cases: Path | None = None, port: str = '0') -> Server:
        command = [sys.executable, '-m', 'imu_workbench', 'serve', '--port', port]
        cases = cases or Path(folder.name) / str(len(started))
        command += ['--case', str(cases)]
        process = subprocess.Popen(
            [*command, *map(str, arguments)], stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        started.append(process)
        assert process.stdout
        line = process.stdout.readline()
        assert line.startswith('workbench at '), line
        return Server(line.split()[2], process, cases)

    yield start
    for process in started:
        process.terminate()
    for process in started:
        process.wait()
    folder.cleanup()


@pytest.fixture
def serve() -> Iterator[Callable[..., Server]]:
    """Start servers for one test, which have computed nothing yet."""
    with servers() as start:
        yield start


@pytest.fixture(scope='session')
def hidden_effect_server() -> Iterator[Server]:
    """One server with the bags of the hidden effect for all tests that need no fresh one."""
    with servers() as start:
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


@pytest.fixture(scope='session')
def browser() -> Iterator[Browser]:
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


@pytest.fixture
def watch(browser: Browser) -> Iterator[Callable[..., Watched]]:
    contexts = []

    def open_page(address: str, width: int = 1280, height: int = 800, **look: Any) -> Watched:
        context = browser.new_context(
            viewport={'width': width, 'height': height},
            accept_downloads=True,
            reduced_motion='reduce',  # spinners cost as much as the work they wait for
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
