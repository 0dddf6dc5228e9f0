# SPDX-License-Identifier: Apache-2.0
"""A real server and a real browser that must not ask anybody else for anything."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).resolve().parents[2]
NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
PATIENCE_MS = 240_000
"""How long the page may take on a machine that is busy."""


def chromium() -> str | None:
    """Return the browser: CHROMIUM, else one on PATH, else None for playwright's own."""
    named = os.environ.get('CHROMIUM')
    return named or next(filter(None, map(shutil.which, NAMES)), None)


@dataclass
class Server:
    """A workbench that runs."""

    address: str
    process: subprocess.Popen[str]

    @property
    def alive(self) -> bool:
        return self.process.poll() is None


@contextmanager
def servers() -> Iterator[Callable[..., Server]]:
    """Provide a function that starts a server on a free port; end them all."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: str | Path) -> Server:
        command = [sys.executable, '-m', 'imu_workbench', 'serve', '--port', '0']
        process = subprocess.Popen(
            [*command, *map(str, arguments)], stdout=subprocess.PIPE, text=True, cwd=ROOT
        )
        started.append(process)
        assert process.stdout
        line = process.stdout.readline()
        assert line.startswith('workbench at '), line
        return Server(line.split()[2], process)

    yield start
    for process in started:
        process.terminate()
    for process in started:
        process.wait()


@pytest.fixture
def serve() -> Iterator[Callable[..., Server]]:
    """Start servers for one test, which have computed nothing yet."""
    with servers() as start:
        yield start


@pytest.fixture(scope='session')
def hidden_effect_server() -> Iterator[Server]:
    """One server with the bags of the hidden effect for all tests that need no fresh one."""
    with servers() as start:
        yield start(*(ROOT / 'bags' / f'hidden_effect_{axis}' for axis in 'xyz'))


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
