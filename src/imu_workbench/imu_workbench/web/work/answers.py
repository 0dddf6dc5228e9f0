# SPDX-License-Identifier: Apache-2.0
"""What a server answers about the versions of a model: what is missing, what to do, the report."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Callable, Collection, Hashable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from thermal_comp.experiment.design import ChamberLimits

from imu_workbench.case import found_in, with_found
from imu_workbench.case_statements import statement_files
from imu_workbench.web.case import tasks
from imu_workbench.web.case.candidates import asks_for_errors
from imu_workbench.web.case.next_experiment import next_profile_task
from imu_workbench.web.case.preview import EffectPreview, preview_task
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.effect_files import EffectFiles
from imu_workbench.web.work.task_runner import TaskRunner

CORES = os.cpu_count() or 1


class AnswerOrder:
    """Order of the work on devices: those a tab shows at once, others when these are answered."""

    def __init__(
        self, devices: Callable[[], Collection[str]], asked: Callable[[], Collection[str]]
    ) -> None:
        """`devices`: all there are, the first is shown first; `asked`: those without an answer."""
        self._devices, self._asked = devices, asked
        self._looked_at: dict[Hashable, str] = {}
        self._running: list[str] = []
        self._waiting: list[asyncio.Future[None]] = []

    def look(self, tab: Hashable, device: str) -> None:
        """Remember which device a tab shows."""
        if self._looked_at.get(tab) != device:
            self._looked_at[tab] = device
            self.changed()

    def leave(self, tab: Hashable) -> None:
        """Forget a tab that was closed."""
        self._looked_at.pop(tab, None)
        self.changed()

    def changed(self) -> None:
        """Let those that wait see whether it is their turn."""
        for waiting in self._waiting:
            if not waiting.done():
                waiting.set_result(None)
        self._waiting = []

    @asynccontextmanager
    async def turn(self, *devices: str) -> AsyncIterator[str]:
        """Wait for the turn of any of these devices; yield which it is."""
        while (device := self._next(devices)) is None:
            self._waiting.append(asyncio.get_running_loop().create_future())
            await self._waiting[-1]
        self._running.append(device)
        try:
            yield device
        finally:
            self._running.remove(device)
            self.changed()

    def _next(self, devices: Collection[str]) -> str | None:
        seen = {*self._looked_at.values()} or {*list(self._devices())[:1]}
        first = next((device for device in devices if device in seen), None)
        if first is not None:
            return first
        awaited = seen & {*self._running, *self._asked()}
        return None if awaited or len(self._running) >= CORES else next(iter(devices))


class Answers:
    """Answers about versions that are loaded; a diagnosis is on disk before anybody sees it."""

    def __init__(
        self, devices: Mapping[str, DeviceWork], effects: EffectFiles, runner: TaskRunner
    ) -> None:
        self._devices, self._effects, self._runner = devices, effects, runner
        self._notices = runner.notices
        self._diagnosing: set[tuple[str, str]] = set()
        self.order = AnswerOrder(lambda: devices, self._asked)
        self._notices.listen(self.order.changed)

    def _asked(self) -> set[str]:
        """Return the devices whose answer is under way."""
        return {d for d, name in self._diagnosing if name not in self._devices[d].found}

    # What is missing ---------------------------------------------------------------------------

    def ask(self, device: str, name: str, *, anew: bool = False) -> None:
        """Begin to find what is missing in a version, unless that is under way."""
        if (device, name) not in self._diagnosing:
            self._diagnosing.add((device, name))
            self._runner.begin(self._diagnose(self._devices[device], name, anew=anew))

    def ask_all_anew(self) -> None:
        """Forget what was found, as other effects may explain it; ask about what is loaded."""
        for work in self._devices.values():
            work.found, work.failed = {}, set()
            for version in list(work.loaded):
                self.ask(work.name, version, anew=True)
        self._notices.tell()

    def is_diagnosing(self, device: str, name: str) -> bool:
        """Tell whether the answer about a version is under way."""
        return (device, name) in self._diagnosing

    def is_holding_out(self, device: str, name: str) -> bool:
        """Tell whether held-out errors of the first candidates are still to be computed."""
        work = self._devices[device]
        found, version = work.found.get(name), work.loaded.get(name)
        if found is None or version is None:
            return False
        return asks_for_errors(found['candidates'], version.effects)

    async def _diagnose(self, work: DeviceWork, name: str, *, anew: bool) -> None:
        """Find what is missing, once for each set of recordings and effects."""
        try:
            if anew or name not in work.found:
                await self._find(work, name, anew=anew)
        finally:
            self._diagnosing.discard((work.name, name))
        self._notices.tell()
        await self._hold_out(work, name)

    async def _find(self, work: DeviceWork, name: str, *, anew: bool) -> None:
        files, prepared = list(self._effects.files), work.prepared
        kept = None if anew or files else found_in(work.case, name)
        if kept is not None:
            work.found[name] = kept
            return
        if name not in work.loaded:
            return
        text = work.loaded[name].model_text
        key = (str(prepared), text, tuple(files))
        arguments = (list(work.bags), prepared, text, files)
        about = f'{work.name} {name}'
        async with self.order.turn(work.name):
            kept = await self._runner.run(about, key, tasks.diagnose_task, *arguments)
        if kept is None or name not in work.loaded:
            return
        if prepared != work.prepared or files != self._effects.files:  # opened in the meantime
            await self._find(work, name, anew=True)
            return
        self._keep_found(work, name, kept | {'errors': work.loaded[name].errors()})

    def _keep_found(self, work: DeviceWork, name: str, found: dict[str, Any]) -> None:
        if not self._effects.files:  # effects of the user's own are not there the next time
            with_found(work.case, name, found)
        work.found[name] = found
        self._notices.tell()

    async def _hold_out(self, work: DeviceWork, name: str) -> None:
        """Compute held-out errors of the first candidates, once the verdict is shown."""
        if not self.is_holding_out(work.name, name):
            return
        found, version, files = work.found[name], work.loaded[name], list(self._effects.files)
        prepared, text = work.prepared, version.model_text
        arguments = (prepared, text, found['candidates'], files)
        key, about = (str(prepared), text, tuple(files)), f'{work.name} {name}'
        async with self.order.turn(work.name):
            weighed = await self._runner.run(about, key, tasks.held_out_task, *arguments)
        if weighed is not None and work.found.get(name) is found:
            self._keep_found(work, name, found | {'candidates': weighed})

    # What to do --------------------------------------------------------------------------------

    async def preview(
        self, device: str, name: str, effect: str, sensor: str
    ) -> EffectPreview | None:
        """Return what an effect would explain of a version's residual."""
        work = self._devices[device]
        if name not in work.loaded:
            return None
        text, files = work.loaded[name].model_text, list(self._effects.files)
        weighed = [c for c in work.candidates(name, sensor) if c.effect == effect]
        shape = dict(weighed[0].shape) if weighed else None
        key = (str(work.prepared), text, effect, sensor, repr(shape), tuple(files))
        arguments = (work.prepared, text, effect, sensor, shape, files)
        about = f'{device} {name}'
        found: EffectPreview | None = await self._runner.run(about, key, preview_task, *arguments)
        return found

    async def next_profile(
        self, device: str, name: str, one: str, other: str
    ) -> dict[str, Any] | None:
        """Return the experiment that tells two effects apart."""
        version, files = self._devices[device].loaded[name], list(self._effects.files)
        missing = version.missing()
        key = (version.model_text, one, other, tuple(files), tuple(missing.items()))
        arguments = (version.model_text, (one, other), ChamberLimits(), files, missing)
        found: dict[str, Any] | None = await self._runner.run(
            f'{device} {name}', key, next_profile_task, *arguments
        )
        return found

    async def report(self, device: str, name: str) -> Path | None:
        """Write the report of a version, the certificate first."""
        work = self._devices[device]
        text, files = work.loaded[name].model_text, list(self._effects.files)
        folder = work.case.folder
        stated = tuple(file.read_bytes() for file in statement_files(folder))
        key = (str(work.prepared), text, tuple(files), stated)
        target = self._runner.cache.fresh_path('.html')
        arguments = (list(work.bags), {device: text}, files, folder, target)
        about = f'{device} {name}'
        found: Path | None = await self._runner.run(about, key, tasks.report_task, *arguments)
        return found
