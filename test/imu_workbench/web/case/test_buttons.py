# SPDX-License-Identifier: Apache-2.0
"""Buttons that are drawn anew act by their key, whichever of them was pressed."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

from imu_workbench.web.case.buttons import Buttons, file_button
from nicegui import Client, ui


def press(part: ui.element, key: str) -> None:
    """Press the button of a key, as the part hears it from the browser."""
    (heard,) = part._event_listeners.values()
    heard.handler(SimpleNamespace(args=key))


def test_a_button_that_was_drawn_anew_acts_as_the_newest_of_its_key(tab: Client) -> None:
    pressed: list[str] = []
    part = ui.element('div')
    buttons = Buttons(part)
    for drawing in ('first', 'second'):
        part.clear()
        with part:
            buttons.add('Add', 'add <lag>', lambda drawing=drawing: pressed.append(drawing))
            buttons.add('Hide', 'hide', lambda: pressed.append('hide'))
    press(part, 'add <lag>')
    press(part, 'hide')
    assert pressed == ['second', 'hide']
    assert [button.props['data-act'] for button in part] == ['add &lt;lag&gt;', 'hide']


def test_a_file_that_is_chosen_is_taken_with_its_name_and_content(tab: Client) -> None:
    taken: list[tuple[str, bytes]] = []

    async def take(name: str, content: bytes) -> None:
        taken.append((name, content))

    async def read() -> bytes:
        return b'x: 1'

    with ui.element('div') as part:
        file_button('Open a model', '.yaml', take)
    upload: Any = next(element for element in part if isinstance(element, ui.upload))
    assert upload.props['accept'] == '.yaml'
    (handler,) = upload._upload_handlers
    asyncio.run(handler(SimpleNamespace(file=SimpleNamespace(name='m.yaml', read=read))))
    assert taken == [('m.yaml', b'x: 1')]
