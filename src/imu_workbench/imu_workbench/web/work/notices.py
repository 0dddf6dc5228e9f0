# SPDX-License-Identifier: Apache-2.0
"""What a server tells every browser tab: that something changed, messages, jobs under way."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from imu_workbench.web.work.jobs import Stoppable


@dataclass(frozen=True)
class Notice:
    """A message that every tab shows."""

    number: int
    text: str
    kind: str = 'error'


class Notices:
    """Messages and jobs of a server, and the listeners that are told of every change."""

    def __init__(self) -> None:
        self.messages: list[Notice] = []
        self.jobs: list[Stoppable] = []
        self._numbers = itertools.count(1)
        self._listeners: list[Callable[[], None]] = []

    def listen(self, listener: Callable[[], None]) -> None:
        """Call a function whenever something has changed."""
        self._listeners.append(listener)

    def leave(self, listener: Callable[[], None]) -> None:
        """Call it no more."""
        if listener in self._listeners:
            self._listeners.remove(listener)

    def tell(self) -> None:
        """Tell everybody that something has changed."""
        for listener in list(self._listeners):
            listener()

    def say(self, text: str, kind: str = 'error') -> None:
        """Show a message in every tab until somebody closes it; the same text once."""
        if all(message.text != text for message in self.messages):
            self.messages.insert(0, Notice(next(self._numbers), text, kind))
            self.tell()

    def close_message(self, number: int) -> None:
        """Take a message away."""
        self.messages = [m for m in self.messages if m.number != number]
        self.tell()

    @contextmanager
    def work(self, job: Stoppable, about: str = '') -> Iterator[None]:
        """Show a job while it is under way; `about`: device and version it is done for."""
        job.about = about
        self.jobs.append(job)
        self.tell()
        try:
            yield
        finally:
            self.jobs.remove(job)
            self.tell()
