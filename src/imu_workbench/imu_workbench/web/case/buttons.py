# SPDX-License-Identifier: Apache-2.0
"""Buttons that work while their part of the page is drawn anew, and buttons that choose a file."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from html import escape
from typing import Any

from nicegui import events, ui

PRESS_HANDLER_JS = """(event) => {
    const button = event.target.closest('[data-act]');
    if (button) emit(button.dataset.act);
}"""


class Buttons:
    """The buttons of one part of the page; their clicks are handled by that part.

    Handlers of an element are lost when it is drawn anew, and a press under way with them. The
    part stays, and tells the action by the key of the button.
    """

    def __init__(self, part: ui.element) -> None:
        self._acts: dict[str, Callable[[], Any]] = {}
        part.on('click', self._press, js_handler=PRESS_HANDLER_JS)
        part.props('data-acts')

    def add(self, label: str, key: str, act: Callable[[], Any]) -> ui.button:
        """Return a new button; its `key` stands for the action: equal actions have equal keys."""
        return self.heard(ui.button(label).props('no-caps'), key, act)

    def heard(self, element: Any, key: str, act: Callable[[], Any]) -> Any:
        """Have an element do something when it is pressed; return it."""
        self._acts[key] = act
        return element.props(f'data-act="{escape(key)}"')

    def _press(self, event: Any) -> Any:
        return self._acts[str(event.args)]()


def file_button(
    label: str, suffixes: str, take: Callable[[str, bytes], Awaitable[None]]
) -> ui.button:
    """Return a button that lets the user choose a file; `take` gets its name and content.

    A browser opens its file chooser for a press only while the press is fresh: it is opened there,
    without asking the server.
    """
    upload = ui.upload(
        on_upload=partial(_hand_over, take), auto_upload=True, max_file_size=20_000_000
    )
    upload.props(f'accept="{suffixes}"').classes('hidden-upload')
    button = ui.button(label).props('no-caps outline')
    return button.on('click', js_handler=f'() => runMethod({upload.id}, "pickFiles", [])')


async def _hand_over(
    take: Callable[[str, bytes], Awaitable[None]], event: events.UploadEventArguments
) -> None:
    await take(event.file.name, await event.file.read())
