# SPDX-License-Identifier: Apache-2.0
"""Versions of a server's models: compared with the recordings, made by the fits in its queue."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

from imu_recording.user_error import UserError

from imu_workbench.case import RequestedFit, saved, with_version
from imu_workbench.web.case import tasks
from imu_workbench.web.case.version import Version
from imu_workbench.web.work.answers import Answers
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.effect_files import EffectFiles
from imu_workbench.web.work.fit_queue import FitQueue, QueuedFit
from imu_workbench.web.work.jobs import JobCancelled, Stoppable
from imu_workbench.web.work.task_runner import TaskRunner

FIRST_LABEL = 'line per axis'


class Versions:
    """Versions of the devices' models; a new one is on disk before anybody sees it."""

    def __init__(
        self,
        devices: Mapping[str, DeviceWork],
        effects: EffectFiles,
        answers: Answers,
        runner: TaskRunner,
    ) -> None:
        self._devices, self._effects, self._answers = devices, effects, answers
        self._runner, self._notices = runner, runner.notices
        self.queue = FitQueue(self._fit, self._queue_changed)

    async def resume(self, device: str, model_text: str | None = None) -> None:
        """Compare the version shown last, or a first one, with the recordings; queue its fits."""
        work = self._devices[device]
        if model_text is not None:
            await self.open_model(device, model_text)
        elif work.case.versions:
            await self.load(device, work.case.current)
        else:
            opened = await self._compared(work, None, FIRST_LABEL)
            if opened is None:
                work.failed.add('')
                self._notices.tell()
            elif not work.case.versions:
                self._append(work, None, opened.version)
        if self.queue.of_device(device):  # asked for here, not of a server that was killed
            return
        for fit in work.case.requested:
            change = tasks.Change(fit.effect, tuple(fit.sensors), fit.added)  # type: ignore[arg-type]
            self.queue.request(device, fit.base, change, fit.tab)

    async def open_model(self, device: str, model_text: str) -> str:
        """Take a model file as a version without a parent; return its name, '' where it failed."""
        work = self._devices[device]
        opened = await self._compared(work, model_text, 'opened model')
        return self._append(work, None, opened.version) if opened is not None else ''

    async def load(self, device: str, name: str) -> Version | None:
        """Return a version as it is drawn, compared with the open recordings."""
        work = self._devices.get(device)
        known = work.case.version(name) if work else None
        if work is None or known is None or not work.bags:
            return None
        if name not in work.loaded:
            try:
                text = work.case.model_text(name)
                self._effects.check(work.case, name, text)
            except UserError as error:
                work.failed.add(name)
                self._notices.say(str(error))
                self._notices.tell()
                return None
            opened = await self._compared(work, text, known.label, name)
            if opened is None:
                if work.bags:
                    work.failed.add(name)
                self._notices.tell()
                return None
            if name in work.loaded:
                return work.loaded[name]
            work.keep(name, opened.version)
        self._answers.ask(device, name)
        self._notices.tell()
        return work.loaded[name]

    def try_again(self, device: str, name: str) -> None:
        """Let a version that could not be compared be loaded anew: its file may be back."""
        work = self._devices[device]
        work.failed.discard(name)
        work.problem = ''
        if not work.case.versions:
            self._runner.begin(self.resume(device))
        self._notices.tell()

    async def _compared(
        self, work: DeviceWork, model_text: str | None, label: str, name: str = ''
    ) -> tasks.Opened | None:
        bags, prepared, files = list(work.bags), work.prepared, list(self._effects.files)
        about, run = f'{work.name} {name}'.strip(), self._runner.run
        opened: tasks.Opened | None = None
        if prepared.exists() or await run(about, prepared, tasks.prepare_task, bags, prepared):
            key = (str(prepared), model_text, tuple(files))
            arguments = (prepared, model_text, label, files)
            opened = await run(about, key, tasks.version_task, *arguments)
        if prepared != work.prepared:  # a recording was opened or closed in the meantime
            return await self._compared(work, model_text, label, name) if work.bags else None
        if opened is None:
            work.problem = 'There is no model of these recordings: see the message above.'
            self._notices.tell()
            return None
        work.problem = ''
        work.unusable, work.left_out = opened.unusable, opened.left_out
        work.bags = [bag for bag in work.bags if bag.run not in opened.left_out]
        work.keep_recordings(
            replace(r, sha256=opened.hashes.get(r.run, r.sha256)) for r in work.case.recordings
        )
        return opened

    def _append(
        self,
        work: DeviceWork,
        parent: str | None,
        version: Version,
        runs: Sequence[str] = (),
    ) -> str:
        """Keep a version of these runs, the open ones where none are named; return its name."""
        opened = [bag.run for bag in work.bags]
        runs = runs or opened
        work.case = self._effects.kept_for(work.case, version)
        label, text = version.label, version.model_text
        work.case = with_version(work.case, parent, label, text, version.errors(), runs)
        name = work.case.current
        if runs == opened:  # else it is compared anew when somebody looks at it
            work.keep(name, version)
            self._answers.ask(work.name, name)
        self._notices.tell()
        return name

    # Fits --------------------------------------------------------------------------------------

    async def _fit(self, fit: QueuedFit) -> None:
        work, start = self._devices[fit.device], fit.start
        runs, prepared = [bag.run for bag in work.bags], work.prepared
        name = fit.change.effect.replace('_', ' ')
        try:
            text, files = work.case.model_text(start), list(self._effects.files)
            key = (str(prepared), text, fit.change, tuple(files))
            arguments = (prepared, text, fit.change, files)

            @contextmanager
            def show(job: Stoppable) -> Iterator[None]:
                fit.job = job
                with self._notices.work(job):
                    yield

            version = await self._runner.cache.compute(show, key, tasks.change_task, *arguments)
        except JobCancelled:
            fit.state = 'cancelled'
            self._notices.say(f'{name}: cancelled; nothing was changed', 'info')
        except UserError as error:
            fit.state = 'failed'
            self._notices.say(f'{name}: {self._runner.plain(str(error))}')
        else:
            fit.result = self._append(work, start, version, runs)
            fit.state = 'done'

    def _queue_changed(self) -> None:
        """Keep what is still to be done in the cases: a server that is killed goes on with it."""
        for work in self._devices.values():
            wanted = tuple(
                RequestedFit(base=f.base if f.follows else f.start, effect=f.change.effect,
                             sensors=f.change.sensors, added=f.change.added, tab=f.tab)
                for f in self.queue.of_device(work.name)
                if f.state in ('waiting', 'running')
            )  # fmt: skip
            if wanted != work.case.requested:
                work.case = saved(replace(work.case, requested=wanted))
        self._notices.tell()
