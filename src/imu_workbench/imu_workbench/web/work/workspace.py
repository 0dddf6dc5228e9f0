# SPDX-License-Identifier: Apache-2.0
"""What every browser tab of a server sees: the cases it works on, and their recordings."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.data.motion import left_out_note

from imu_workbench.case import (
    CASE_FILE,
    Case,
    case_of_device,
    cases_in,
    found_in,
    is_unchanged,
    load_case,
    saved,
)
from imu_workbench.case_statements import keep_statement
from imu_workbench.web.case import tasks
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.case.verdict import verdict_of
from imu_workbench.web.work.answers import Answers
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.effect_files import EffectFiles
from imu_workbench.web.work.jobs import JobCancelled
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.result_cache import ResultCache, file_key
from imu_workbench.web.work.task_runner import TaskRunner
from imu_workbench.web.work.versions import Versions


class Workspace:
    """The cases of one server. Every change is on disk before anybody is told of it."""

    def __init__(
        self, cache: ResultCache, cases: Path, remap: Mapping[str, str] | None = None
    ) -> None:
        self.cache, self.cases = cache, cases
        self.devices: dict[str, DeviceWork] = {}
        self.notices = Notices()
        self.runner = TaskRunner(cache, self.notices)
        self.effects = EffectFiles(self.runner, cases, self._effects_changed)
        self.answers = Answers(self.devices, self.effects, self.runner)
        self.versions = Versions(self.devices, self.effects, self.answers, self.runner)
        self.opening = True
        """Until everything the server was started with has been looked at."""
        self.reading = 0
        """Bags that are still to be read."""
        self._remap = dict(remap or {})
        self._closed_cases: dict[Path, tuple[int, tuple[Case, str]]] = {}
        """Cases that are not open, by folder: time of modification [ns] and content at that
        time."""

    def _effects_changed(self) -> None:
        self.answers.ask_all_anew()

    # Cases -------------------------------------------------------------------------------------

    async def start(
        self,
        bags: Sequence[Path],
        effects: Sequence[Path],
        *,
        case: Path | None = None,
        model_text: str | None = None,
        run_kept: bool = False,
    ) -> None:
        """Open what the server was started with: cases, bags, effect files.

        `run_kept`: effect files of a case that were given here before are loaded by themselves.
        """
        for file in (f for p in effects for f in (sorted(p.glob('*.py')) if p.is_dir() else [p])):
            await self.effects.load(file.name, file.read_bytes())
        cases = [load_case(path) for path in ([case] if case else cases_in(self.cases))]
        given = [str(bag) for bag in bags]
        paths = given or [s for one in cases for s in one.sources]
        for one in cases:
            if not given or (one.sources and {*one.sources} <= {*given}):
                self._show_kept(one)
            if run_kept and (not given or {*one.sources} & {*given}):
                await self.effects.load_allowed(one)
        await self.open_bags(paths, model_text)
        self.opening = False
        self.notices.tell()

    def fleet(self) -> list[tuple[Case, str]]:
        """Return every case of this server, open or not, with the verdict on its version.

        '' stands for a verdict that is not known; a message names cases that cannot be read.
        """
        open_now = {work.case.folder: work for work in self.devices.values()}
        known = []
        for path in cases_in(self.cases):
            work = open_now.get(path)
            try:
                if work is None:
                    known.append(self._case_on_disk(path))
                else:
                    known.append((work.case, verdict_of(work.found.get(work.case.current))))
            except UserError as error:
                self.notices.say(str(error))
        return known

    def _case_on_disk(self, path: Path) -> tuple[Case, str]:
        changed = (path / CASE_FILE).stat().st_mtime_ns
        if path not in self._closed_cases or self._closed_cases[path][0] != changed:
            case = load_case(path)
            found = verdict_of(found_in(case, case.current))
            self._closed_cases[path] = (changed, (case, found))
        return self._closed_cases[path][1]

    def open_case(self, device: str) -> Awaitable[Any]:
        """Show what the case of a device keeps; wait for its recordings to be read."""
        case = next((one for one, _ in self.fleet() if one.device == device), None)
        if case is None or device in self.devices:
            return asyncio.sleep(0.0)
        self._show_kept(case)
        return self.open_bags(case.sources)

    def _show_kept(self, case: Case) -> None:
        """Show what a case keeps while its recordings are read, as far as they are unchanged."""
        work = self.devices[case.device] = DeviceWork(case)
        if all(is_unchanged(recording) for recording in case.recordings if recording.open):
            kept = found_in(case, case.current)
            work.found = {} if kept is None else {case.current: kept}

    def show(self, device: str, name: str) -> None:
        """Remember the version that was shown last."""
        work = self.devices[device]
        if work.case.current != name and work.case.version(name):
            work.case = saved(replace(work.case, current=name))

    def note(self, device: str, text: str) -> None:
        """Keep the user's notes."""
        work = self.devices[device]
        work.case = saved(replace(work.case, notes=text))

    def keep_statement(self, device: str, name: str, content: bytes) -> None:
        """Keep what a laboratory states, or limits, in the case: certificates state it then."""
        try:
            kept = keep_statement(self.devices[device].case.folder, name, content)
        except UserError as error:
            self.notices.say(str(error))
            return
        self.notices.say(
            f'{name} is kept in the case as {kept}: certificates state it from now on', 'info'
        )

    # Recordings --------------------------------------------------------------------------------

    async def open_bags(
        self, paths: Sequence[str | Path], model_text: str | None = None
    ) -> list[str]:
        """Read bags, put them into the cases of their devices; return the devices they are of."""
        changed: list[str] = []
        reading = [asyncio.ensure_future(self._read(path)) for path in paths]
        for path, bags in zip(paths, reading, strict=True):
            for device in self._take(path, await bags):
                changed += [device] if device not in changed else []
            self.notices.tell()
        left = list(changed)
        while left:
            async with self.answers.order.turn(*left) as device:
                left.remove(device)
                self.devices[device].close_unread()
                await self.versions.resume(device, model_text)
        return changed

    async def _read(self, path: str | Path) -> list[StoredBag]:
        try:
            located = self.cache.root.locate(path)
        except UserError as error:
            self.notices.say(str(error))
            return []
        folder = self.cache.fresh_path()
        arguments = (located, folder, self._remap)
        self.reading += 1
        try:
            async with self.cache.reading(located, self.notices.work):
                found: list[StoredBag] | None = await self.runner.run(
                    located.name, file_key(located), tasks.read_task, *arguments
                )
        except JobCancelled:  # while it waited
            self.notices.say(f'{located.name}: cancelled', 'info')
            return []
        finally:
            self.reading -= 1
        return found or []

    def _take(self, path: str | Path, found: Sequence[StoredBag]) -> list[str]:
        """Put recordings that rest into the cases of their devices."""
        known = {bag.folder for work in self.devices.values() for bag in work.bags}
        moving = [bag for bag in found if bag.motion]
        for bag in moving:
            self.notices.say(left_out_note(bag.run, bag.motion))
        resting = [bag for bag in found if bag not in moving]
        new = [bag for bag in resting if bag.folder not in known]
        if resting and not new:
            self.notices.say(f'{Path(path).name}: open already', 'info')
        devices = list(dict.fromkeys(bag.device for bag in new))
        for device in devices:
            if device not in self.devices:
                self.devices[device] = DeviceWork(case_of_device(self.cases, device))
            work = self.devices[device]
            bags = [*work.bags, *(bag for bag in new if bag.device == device)]
            work.take_bags(bags, self.cache)
        return devices

    async def close_bag(self, device: str, run: str) -> None:
        """Close a recording; the case keeps it and its versions."""
        work = self.devices[device]
        work.take_bags([bag for bag in work.bags if bag.run != run], self.cache)
        work.close_unread()
        self.notices.tell()
        if work.bags:
            await self.versions.resume(device)
