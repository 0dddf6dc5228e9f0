# SPDX-License-Identifier: Apache-2.0
"""Messages that stay on the page until they are closed, and the work that is under way."""

from __future__ import annotations

from nicegui import ui

from imu_workbench.web.job import Stoppable

MOST = 4
"""Messages that stay."""


class Messages:
    """Errors and remarks, newest first."""

    def __init__(self) -> None:
        self._place = ui.element('div').classes('messages').props('role=alert aria-live=assertive')

    def say(self, text: str, kind: str = 'error') -> None:
        """Show a message; the same text once."""
        for child in list(self._place):
            if getattr(child, 'told', None) == text:
                return
        with self._place:
            row = ui.element('div').classes(f'message {kind}')
            row.told = text  # type: ignore[attr-defined]
            with row:
                ui.label(text)
                close = (
                    ui.element('button')
                    .classes('close')
                    .props('type=button aria-label="close this message"')
                )
                close.on('click', row.delete)
                with close:
                    ui.label('×')
        row.move(target_index=0)
        for child in list(self._place)[MOST:]:
            child.delete()

    def clear(self) -> None:
        """Close all messages."""
        self._place.clear()


class Work:
    """The jobs of a tab: what they do, and a button to stop each."""

    def __init__(self) -> None:
        self.jobs: list[Stoppable] = []
        self._place = ui.element('div').classes('work').props('role=status aria-live=polite')
        self._labels: dict[Stoppable, ui.label] = {}
        self._timer = ui.timer(0.25, self._tell, active=False)

    def start(self, job: Stoppable) -> None:
        """Show a job."""
        self.jobs.append(job)
        with self._place:
            row = ui.element('div').classes('job')
            with row:
                ui.spinner(size='1.1em')
                self._labels[job] = ui.label('starting …')
                ui.button('Cancel', on_click=job.cancel).props('no-caps flat dense')
        self._timer.activate()

    def end(self, job: Stoppable) -> None:
        """Take a job off the page."""
        if job in self.jobs:
            self.jobs.remove(job)
            self._labels.pop(job).parent_slot.parent.delete()  # type: ignore[union-attr]
        if not self.jobs:
            self._timer.deactivate()

    def cancel_all(self) -> None:
        """End every job."""
        for job in self.jobs:
            job.cancel()

    def _tell(self) -> None:
        for job, label in self._labels.items():
            label.set_text(f'{job.progress} …' if job.progress else 'starting …')
