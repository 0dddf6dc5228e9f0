# SPDX-License-Identifier: Apache-2.0
"""Fits that were asked for, done one after the other; finished ones are kept for their tabs."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Literal

from imu_workbench.web.case.tasks import Change
from imu_workbench.web.work.jobs import Stoppable

MOST_FINISHED = 50
"""Finished fits that are remembered, so that tabs can show what they asked for."""
State = Literal['waiting', 'running', 'done', 'failed', 'cancelled']


@dataclass(eq=False)
class QueuedFit:
    """One change of one version of a device's model."""

    device: str
    base: str
    """The version it was asked for on."""
    change: Change
    tab: str = ''
    """The browser tab that asked."""
    after: QueuedFit | None = None
    """A fit asked for before on the same version: this one goes on from its result."""
    state: State = 'waiting'
    result: str = ''
    """The version that was made."""
    job: Stoppable | None = None
    number: int = field(default_factory=itertools.count(1).__next__)

    @property
    def start(self) -> str:
        """The version it starts from: what the fit before it made, else that fit's own start."""
        if self.after is None:
            return self.base
        return self.after.result or self.after.start

    @property
    def follows(self) -> bool:
        """Whether a fit before it has still to be done."""
        return self.after is not None and self.after.state in ('waiting', 'running')

    @property
    def told(self) -> str:
        """What is done, in words."""
        places = f' ({", ".join(self.change.sensors)})' if self.change.sensors else ''
        if self.after and self.follows:
            return f'{self._action}{places}, after “{self.after._action}”'
        return f'{self._action}{places} {"on" if self.change.added else "from"} {self.start}'

    @property
    def _action(self) -> str:
        verb = 'add' if self.change.added else 'take out'
        return f'{verb} {self.change.effect.replace("_", " ")}'


class FitQueue:
    """The fits of a server; `fit` does one, `changed` is called whenever the list changes."""

    def __init__(
        self, fit: Callable[[QueuedFit], Awaitable[None]], changed: Callable[[], None]
    ) -> None:
        self.fits: list[QueuedFit] = []
        """Waiting and running, in order."""
        self.finished: list[QueuedFit] = []
        """Those that made a version."""
        self._fit, self._changed = fit, changed
        self._runner: asyncio.Task[None] | None = None

    def request(self, device: str, base: str, change: Change, tab: str = '') -> QueuedFit:
        """Queue a change; a second one of the same version follows the first."""
        same = [f for f in self.fits if (f.device, f.base, f.tab) == (device, base, tab)]
        fit = QueuedFit(
            device=device, base=base, change=change, tab=tab, after=same[-1] if same else None
        )
        self.fits.append(fit)
        self._changed()
        if self._runner is None or self._runner.done():
            self._runner = asyncio.ensure_future(self._run())
        return fit

    def cancel(self, fit: QueuedFit) -> None:
        """Take a waiting fit off the list, or stop the one that runs."""
        if fit.state == 'waiting' and fit in self.fits:
            fit.state = 'cancelled'
            self.fits.remove(fit)
            self._changed()
        elif fit.job is not None:
            fit.job.cancel()

    def forget(self, tab: str) -> None:
        """Forget the finished fits of a tab, whose user looks at something else by now."""
        self.finished = [fit for fit in self.finished if fit.tab != tab]

    def of_device(self, device: str) -> list[QueuedFit]:
        """Return the fits of one device, in order."""
        return [fit for fit in self.fits if fit.device == device]

    async def _run(self) -> None:
        while self.fits:
            fit = self.fits[0]
            fit.state = 'running'
            self._changed()
            try:
                await self._fit(fit)
            finally:
                if fit.state == 'running':
                    fit.state = 'failed'
                self.fits.remove(fit)
                if fit.result:
                    self.finished = [*self.finished, fit][-MOST_FINISHED:]
                self._changed()
