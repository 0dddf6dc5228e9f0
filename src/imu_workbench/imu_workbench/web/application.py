# SPDX-License-Identifier: Apache-2.0
"""The page as a web application: styles, scripts, access, and its server.

It alone imports the web libraries, which take seconds: the server reads recordings meanwhile.
"""

from __future__ import annotations

import socket
from collections.abc import Callable
from importlib.resources import files

import uvicorn
from fastapi import FastAPI, Request
from fastapi.middleware.gzip import GZipMiddleware
from nicegui import app as nicegui_app
from nicegui import ui

from imu_workbench.web.access import AccessCheck
from imu_workbench.web.page import Page
from imu_workbench.web.work.workspace import Workspace

STYLE_FILES = ('base.css', 'theme.css')
SCRIPT_FILES = ('watching.js', 'cells.js', 'cursor.js', 'focus.js', 'saving.js')
RECONNECT_S = 30.0
"""A tab that lost the server keeps its state so long."""


async def serve(
    listening: socket.socket,
    workspace: Workspace,
    *,
    local: bool,
    token: str,
    ready: Callable[[], None],
) -> None:
    """Serve the page until interrupted; `local`: only this machine can open it."""
    outer = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    outer.add_middleware(AccessCheck, token=token)
    here = files('imu_workbench') / 'web'
    look = ''.join((here / name).read_text('utf-8') for name in STYLE_FILES)
    scripts = [(here / name).read_text('utf-8') for name in SCRIPT_FILES]

    @ui.page('/', response_timeout=30.0)  # type: ignore[untyped-decorator]
    def _page(request: Request) -> None:
        ui.add_css(look)
        ui.add_head_html(''.join(f'<script>{script}</script>' for script in scripts))
        ui.query('.nicegui-content').classes('content')
        Page(workspace, dict(request.query_params), local=local)

    nicegui_app.on_startup(ready)
    ui.run_with(
        outer,
        title='IMU workbench',
        favicon='📈',
        dark=None,
        language='en-US',
        reconnect_timeout=RECONNECT_S,
        show_welcome_message=False,
        tailwind=False,
        # On one machine, compressing the libraries of the page takes longer than to send them.
        gzip_middleware_factory=None if local else GZipMiddleware,
    )
    settings = uvicorn.Config(
        outer, log_level='warning', lifespan='on', ws_per_message_deflate=not local
    )
    await uvicorn.Server(settings).serve(sockets=[listening])
