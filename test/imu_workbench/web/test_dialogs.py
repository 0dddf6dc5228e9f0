# SPDX-License-Identifier: Apache-2.0
"""Messages and work under way, as a tab shows them."""

from __future__ import annotations

import time
from types import SimpleNamespace

from imu_workbench.web.dialogs import Messages, WorkPanel
from imu_workbench.web.work.notices import Notices
from nicegui import Client, ui


def texts_of(client: Client) -> list[str]:
    return [e.text for e in client.elements.values() if isinstance(e, ui.label) and e.text != '×']


def test_a_message_stands_once_until_somebody_closes_it(tab: Client) -> None:
    notices = Notices()
    messages = Messages(notices)
    for text in ('a bag is torn', 'a bag is torn', 'no rest'):
        notices.say(text)
    messages.refresh()
    assert sorted(texts_of(tab)) == ['a bag is torn', 'no rest']
    close = [e for e in tab.elements.values() if e.tag == 'button']
    (heard,) = close[0]._event_listeners.values()
    heard.handler(None)
    messages.refresh()
    assert len(texts_of(tab)) == 1


def test_work_under_way_shows_its_progress_and_is_cancelled_by_its_button(tab: Client) -> None:
    cancelled: list[str] = []
    job = SimpleNamespace(
        progress='reading', about='dut1 v2', began=time.monotonic(), expected_end=None,
        cancel=lambda: cancelled.append('dut1'),
    )  # fmt: skip
    workspace = SimpleNamespace(
        versions=SimpleNamespace(queue=SimpleNamespace(fits=[])),
        notices=SimpleNamespace(jobs=[job]),
    )
    panel = WorkPanel(workspace)
    panel.refresh()
    (told,) = texts_of(tab)
    assert told.startswith('dut1 v2: reading …')
    (button,) = (e for e in tab.elements.values() if isinstance(e, ui.button))
    assert button.text == 'Cancel'
    (heard,) = button._event_listeners.values()
    heard.handler(None)
    assert cancelled == ['dut1']
    workspace.notices.jobs = []
    panel.refresh()
    assert texts_of(tab) == []
