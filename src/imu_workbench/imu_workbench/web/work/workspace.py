# SPDX-License-Identifier: Apache-2.0
"""The cases a server works on: what every browser tab of it sees, and what is done to them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.data.motion import left_out_note
from thermal_comp.effects import EFFECTS
from thermal_comp.experiment.design import Limits

from imu_workbench.case import (
    CASE_FILE,
    Case,
    CaseError,
    CaseRecording,
    RequestedFit,
    case_of_device,
    cases_in,
    found_in,
    is_unchanged,
    known_recordings,
    load_case,
    saved,
    with_found,
    with_version,
)
from imu_workbench.case_effects import (
    allow,
    allowed_in,
    digest,
    effect_file,
    kept_effects,
    with_effect_file,
)
from imu_workbench.case_statements import keep_statement, statement_files
from imu_workbench.web.case import tasks
from imu_workbench.web.case.candidates import asks_for_errors
from imu_workbench.web.case.next_experiment import next_profile_task
from imu_workbench.web.case.preview import EffectPreview, preview_task
from imu_workbench.web.case.stored_bag import StoredBag, with_unique_runs
from imu_workbench.web.case.verdict import verdict_of
from imu_workbench.web.case.version import Version
from imu_workbench.web.work.answer_order import AnswerOrder
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.fit_queue import FitQueue, QueuedFit
from imu_workbench.web.work.jobs import JobCancelled, JobError, Stoppable
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.result_cache import ResultCache, file_key

FIRST_LABEL = 'line per axis'


class Workspace(Notices):
    """The cases of one server. Every change is on disk before anybody is told of it."""

    def __init__(
        self, cache: ResultCache, cases: Path, remap: Mapping[str, str] | None = None
    ) -> None:
        super().__init__()
        self.cache, self.cases = cache, cases
        self.devices: dict[str, DeviceWork] = {}
        self.effect_files: list[Path] = []
        self._effect_homes: dict[str, Path] = {}
        """Effect of the user's own → its file."""
        self.effects: dict[str, dict[str, Any]] = tasks.effect_explanations(EFFECTS)
        """What `explain` says of every effect, by name."""
        self.queue = FitQueue(self._fit, self._queue_changed)
        self.opening = True
        """Until everything the server was started with has been looked at."""
        self._remap = dict(remap or {})
        self._closed_cases: dict[Path, tuple[int, tuple[Case, str]]] = {}
        """Cases nobody has opened, by folder, as they were at a time of modification [ns]."""
        self._diagnosing: set[tuple[str, str]] = set()
        self.order = AnswerOrder(lambda: self.devices, self._asked)
        self._background: set[asyncio.Task[Any]] = set()

    def tell(self) -> None:
        """Tell everybody that something has changed."""
        super().tell()
        self.order.changed()

    def _asked(self) -> set[str]:
        """Return the devices whose answer is under way."""
        return {d for d, name in self._diagnosing if name not in self.devices[d].found}

    # Recordings --------------------------------------------------------------------------------

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
            await self.load_effects(file.name, file.read_bytes())
        cases = [load_case(path) for path in ([case] if case else cases_in(self.cases))]
        given = [str(bag) for bag in bags]
        paths = given or [s for one in cases for s in one.sources]
        for one in cases:
            if not given or (one.sources and {*one.sources} <= {*given}):
                self._show_kept(one)
            if run_kept and (not given or {*one.sources} & {*given}):
                for key in [k for k in kept_effects(one) if k in allowed_in(self.cases)]:
                    await self.load_kept_effects(one, key)
        await self.open_bags(paths, model_text)
        self.opening = False
        self.tell()

    async def open_bags(
        self, paths: Sequence[str | Path], model_text: str | None = None
    ) -> list[str]:
        """Read bags, put them into the cases of their devices; return the devices they are of."""
        changed: list[str] = []
        reading = [asyncio.ensure_future(self._read(path)) for path in paths]
        for path, bags in zip(paths, reading, strict=True):
            for device in self._take(path, await bags):
                changed += [device] if device not in changed else []
            self.tell()
        left = list(changed)
        while left:
            async with self.order.turn(*left) as device:
                left.remove(device)
                self._close_unread(self.devices[device])
                await self._prepare(device, model_text)
        return changed

    def fleet(self) -> list[tuple[Case, str]]:
        """Return every case of this server, open or not, with the verdict on its version.

        '' stands for a verdict that is not known; cases that cannot be read are said.
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
                self.say(str(error))
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

    def _take(self, path: str | Path, found: Sequence[StoredBag]) -> list[str]:
        """Put recordings that rest into the cases of their devices."""
        known = {bag.folder for work in self.devices.values() for bag in work.bags}
        moving = [bag for bag in found if bag.motion]
        for bag in moving:
            self.say(left_out_note(bag.run, bag.motion))
        resting = [bag for bag in found if bag not in moving]
        new = [bag for bag in resting if bag.folder not in known]
        if resting and not new:
            self.say(f'{Path(path).name}: open already', 'info')
        devices = list(dict.fromkeys(bag.device for bag in new))
        for device in devices:
            work = self.devices.get(device)
            if work is None:
                work = DeviceWork(case_of_device(self.cases, device))
                self.devices[device] = work
            own = [bag for bag in new if bag.device == device]
            work.bags = with_unique_runs([*work.bags, *own])
            self._bags_changed(work)
        return devices

    def _bags_changed(self, work: DeviceWork) -> None:
        """Bring the case up to date with the recordings that were read."""
        hashes = {r.run: r.sha256 for r in work.case.recordings}
        read = [
            CaseRecording(b.source, b.run, hashes.get(b.run, ''), b.samples, True, *b.file_state)
            for b in work.bags
        ]
        runs = {bag.run for bag in work.bags}
        others = [r for r in work.case.recordings if r.run not in runs]
        self._keep_recordings(work, [*read, *others])
        work.prepared = self.cache.prepared_path(work.bags)
        work.loaded, work.failed, work.problem = {}, set(), ''

    def _close_unread(self, work: DeviceWork) -> None:
        """Take those for closed that were not read."""
        runs = {bag.run for bag in work.bags}
        recordings = [r if r.run in runs else replace(r, open=False) for r in work.case.recordings]
        self._keep_recordings(work, recordings)

    def _keep_recordings(self, work: DeviceWork, recordings: Sequence[CaseRecording]) -> None:
        """Save the recordings; what was found in others is forgotten."""
        before = known_recordings(work.case)
        work.case = saved(replace(work.case, recordings=tuple(recordings)))
        if known_recordings(work.case) != before:
            work.found = {}

    async def close_bag(self, device: str, run: str) -> None:
        """Close a recording; the case knows it still, and its versions stay."""
        work = self.devices[device]
        work.bags = [bag for bag in work.bags if bag.run != run]
        self._bags_changed(work)
        self._close_unread(work)
        self.tell()
        if work.bags:
            await self._prepare(device)

    async def _read(self, path: str | Path) -> list[StoredBag]:
        try:
            located = self.cache.root.locate(path)
        except UserError as error:
            self.say(str(error))
            return []
        folder = self.cache.fresh_path()
        try:
            async with self.cache.reading(located, self.work):
                found: list[StoredBag] | None = await self._do(
                    '', file_key(located), tasks.read_task, located, folder, self._remap
                )
        except JobCancelled:
            return []
        return found or []

    async def _prepare(self, device: str, model_text: str | None = None) -> None:
        """Bring the shown version, else a first one, onto the recordings; then diagnose it."""
        work = self.devices[device]
        if model_text is not None:
            await self.open_model(device, model_text)
        elif work.case.versions:
            await self.load(device, work.case.current)
        else:
            opened = await self._opened(work, None, FIRST_LABEL)
            if opened is not None:
                self._append(work, None, opened.version)
        for fit in work.case.requested:
            change = tasks.Change(fit.effect, tuple(fit.sensors), fit.added)  # type: ignore[arg-type]
            self.queue.request(device, fit.base, change)

    async def _opened(
        self, work: DeviceWork, model_text: str | None, label: str, name: str = ''
    ) -> tasks.Opened | None:
        bags, files = list(work.bags), list(self.effect_files)
        key = (str(work.prepared), model_text, tuple(files))
        arguments = (bags, work.prepared, model_text, label, files)
        about = f'{work.name} {name}'.strip()
        opened: tasks.Opened | None = await self._do(about, key, tasks.version_task, *arguments)
        if opened is None:
            work.problem = 'There is no model of these recordings: see the message above.'
            self.tell()
            return None
        work.problem = ''
        work.unusable, work.left_out = opened.unusable, opened.left_out
        work.bags = [bag for bag in work.bags if bag.run not in opened.left_out]
        recordings = [
            replace(r, sha256=opened.hashes.get(r.run, r.sha256)) for r in work.case.recordings
        ]
        self._keep_recordings(work, recordings)
        return opened

    # Versions ----------------------------------------------------------------------------------

    async def open_model(self, device: str, model_text: str) -> str:
        """Take a model file as a version without a parent; return its name, '' where it failed."""
        work = self.devices[device]
        opened = await self._opened(work, model_text, 'opened model')
        return self._append(work, None, opened.version) if opened is not None else ''

    def keep_statement(self, device: str, name: str, content: bytes) -> None:
        """Keep what a laboratory states, or limits, in the case: certificates state it then."""
        try:
            kept = keep_statement(self.devices[device].case.folder, name, content)
        except UserError as error:
            self.say(str(error))
            return
        self.say(
            f'{name} is kept in the case as {kept}: certificates state it from now on', 'info'
        )

    def _append(self, work: DeviceWork, parent: str | None, version: Version) -> str:
        runs = [bag.run for bag in work.bags]
        used = {name for names in version.effects.values() for name in names}
        for file in {self._effect_homes[name] for name in used & {*self._effect_homes}}:
            work.case = with_effect_file(work.case, file)
        label, text = version.label, version.model_text
        work.case = with_version(work.case, parent, label, text, version.errors(), runs)
        name = work.case.current
        work.keep(name, version)
        self.ask(work.name, name)
        self.tell()
        return name

    async def load(self, device: str, name: str) -> Version | None:
        """Return a version as it is drawn, compared with the open recordings."""
        work = self.devices.get(device)
        known = work.case.version(name) if work else None
        if work is None or known is None or not work.bags:
            return None
        if name not in work.loaded:
            try:
                text = work.case.model_text(name)
                self._ask_for_effects(work.case, name, text)
            except UserError as error:
                self.say(str(error))
                work.failed.add(name)
                return None
            opened = await self._opened(work, text, known.label, name)
            if opened is None:
                work.failed.add(name)
                self.tell()
                return None
            if name in work.loaded:
                return work.loaded[name]
            work.keep(name, opened.version)
        self.ask(device, name)
        self.tell()
        return work.loaded[name]

    def show(self, device: str, name: str) -> None:
        """Remember the version that was shown last."""
        work = self.devices[device]
        if work.case.current != name and work.case.version(name):
            work.case = saved(replace(work.case, current=name))

    def note(self, device: str, text: str) -> None:
        """Keep the user's notes."""
        work = self.devices[device]
        work.case = saved(replace(work.case, notes=text))

    def begin(self, work: Any) -> None:
        """Do something that nobody waits for; what it fails with is said."""
        task = asyncio.ensure_future(work)
        self._background.add(task)
        task.add_done_callback(self._background.discard)

    def ask(self, device: str, name: str, *, anew: bool = False) -> None:
        """Begin to find what is missing in a version, unless that is under way."""
        if (device, name) not in self._diagnosing:
            self._diagnosing.add((device, name))
            self.begin(self._diagnose(self.devices[device], name, anew=anew))

    async def _diagnose(self, work: DeviceWork, name: str, *, anew: bool) -> None:
        """Find what is missing, once for each set of recordings and effects."""
        try:
            if anew or name not in work.found:
                await self._find(work, name, anew=anew)
        finally:
            self._diagnosing.discard((work.name, name))
        self.tell()
        await self._hold_out(work, name)

    async def _find(self, work: DeviceWork, name: str, *, anew: bool) -> None:
        kept = None if anew or self.effect_files else found_in(work.case, name)
        if kept is not None:
            work.found[name] = kept
            return
        if name not in work.loaded:
            return
        text, files, prepared = (
            work.loaded[name].model_text,
            list(self.effect_files),
            work.prepared,
        )
        key = (str(prepared), text, tuple(files))
        arguments = (list(work.bags), prepared, text, files)
        async with self.order.turn(work.name):
            kept = await self._do(f'{work.name} {name}', key, tasks.diagnose_task, *arguments)
        if kept is None or name not in work.loaded:
            return
        if prepared != work.prepared or files != self.effect_files:  # opened in the meantime
            await self._find(work, name, anew=True)
            return
        self._keep_found(work, name, kept | {'errors': work.loaded[name].errors()})

    def _keep_found(self, work: DeviceWork, name: str, found: dict[str, Any]) -> None:
        if not self.effect_files:  # effects of the user's own are not there the next time
            with_found(work.case, name, found)
        work.found[name] = found
        self.tell()

    async def _hold_out(self, work: DeviceWork, name: str) -> None:
        """Say what the candidates in front would leave: after the verdict, which needs it not."""
        if not self.is_holding_out(work.name, name):
            return
        found, version, files = work.found[name], work.loaded[name], list(self.effect_files)
        prepared, text = work.prepared, version.model_text
        arguments = (prepared, text, found['candidates'], files)
        key = (str(prepared), text, tuple(files))
        async with self.order.turn(work.name):
            weighed = await self._do(f'{work.name} {name}', key, tasks.held_out_task, *arguments)
        if weighed is not None and work.found.get(name) is found:
            self._keep_found(work, name, found | {'candidates': weighed})

    def is_diagnosing(self, device: str, name: str) -> bool:
        """Tell whether the answer about a version is under way."""
        return (device, name) in self._diagnosing

    def is_holding_out(self, device: str, name: str) -> bool:
        """Tell whether what the candidates in front would leave is still to be said."""
        work = self.devices[device]
        found, version = work.found.get(name), work.loaded.get(name)
        if found is None or version is None:
            return False
        return asks_for_errors(found['candidates'], version.effects)

    # Fits --------------------------------------------------------------------------------------

    def request(self, device: str, base: str, change: tasks.Change, tab: str = '') -> None:
        """Queue an effect to be added to a version, or taken out of it."""
        self.queue.request(device, base, change, tab)

    async def _fit(self, fit: QueuedFit) -> None:
        work, start = self.devices[fit.device], fit.start
        name = fit.change.effect.replace('_', ' ')
        try:
            text, files = work.case.model_text(start), list(self.effect_files)
            key = (str(work.prepared), text, fit.change, tuple(files))
            arguments = (work.prepared, text, fit.change, files)

            @contextmanager
            def show(job: Stoppable) -> Iterator[None]:
                fit.job = job
                with self.work(job):
                    yield

            version = await self.cache.compute(show, key, tasks.change_task, *arguments)
        except JobCancelled:
            fit.state = 'cancelled'
            self.say(f'{name}: cancelled; nothing was changed', 'info')
        except UserError as error:
            fit.state = 'failed'
            self.say(f'{name}: {self._plain(str(error))}')
        else:
            fit.result = self._append(work, start, version)
            fit.state = 'done'

    def _queue_changed(self) -> None:
        """Keep what is still to be done in the cases: a server that is killed goes on with it."""
        for work in self.devices.values():
            wanted = tuple(
                RequestedFit(f.base if f.follows else f.start, f.change.effect,
                             f.change.sensors, f.change.added)
                for f in self.queue.of_device(work.name)
                if f.state in ('waiting', 'running')
            )  # fmt: skip
            if wanted != work.case.requested:
                work.case = saved(replace(work.case, requested=wanted))
        self.tell()

    # Answers -----------------------------------------------------------------------------------

    async def preview(
        self, device: str, name: str, effect: str, sensor: str
    ) -> EffectPreview | None:
        """Return what an effect would explain of a version's residual."""
        work = self.devices[device]
        if name not in work.loaded:
            return None
        text, files = work.loaded[name].model_text, list(self.effect_files)
        weighed = [c for c in work.candidates(name, sensor) if c.effect == effect]
        shape = dict(weighed[0].shape) if weighed else None
        key = (str(work.prepared), text, effect, sensor, repr(shape), tuple(files))
        arguments = (work.prepared, text, effect, sensor, shape, files)
        found: EffectPreview | None = await self._do(
            f'{device} {name}', key, preview_task, *arguments
        )
        return found

    async def next_profile(
        self, device: str, name: str, one: str, other: str
    ) -> dict[str, Any] | None:
        """Return the experiment that tells two effects apart."""
        version, files = self.devices[device].loaded[name], list(self.effect_files)
        missing = version.missing()
        key = (version.model_text, one, other, tuple(files), tuple(missing.items()))
        arguments = (version.model_text, (one, other), Limits(), files, missing)
        found: dict[str, Any] | None = await self._do(
            f'{device} {name}', key, next_profile_task, *arguments
        )
        return found

    async def report(self, device: str, name: str) -> Path | None:
        """Write the report of a version, the certificate first."""
        work = self.devices[device]
        text, files = work.loaded[name].model_text, list(self.effect_files)
        folder = work.case.folder
        stated = tuple(file.read_bytes() for file in statement_files(folder))
        key = (str(work.prepared), text, tuple(files), stated)
        target = self.cache.fresh_path('.html')
        arguments = (list(work.bags), {device: text}, files, folder, target)
        found: Path | None = await self._do(f'{device} {name}', key, tasks.report_task, *arguments)
        return found

    def effects_to_load(self, case: Case) -> dict[str, str]:
        """Return the effect files of a case that are not loaded: SHA-256 → name."""
        loaded = {digest(file.read_bytes()) for file in self.effect_files}
        return {key: name for key, name in kept_effects(case).items() if key not in loaded}

    def _ask_for_effects(self, case: Case, version: str, model_text: str) -> None:
        """Refuse a model whose effect file is kept in the case and not loaded."""
        for key, name in self.effects_to_load(case).items():
            if key[:16] in model_text:  # as `source` of an effect names its file
                raise CaseError(
                    f'{version} needs {name}, which is kept in the case: load it below the '
                    'candidates (it runs code), or start the server with --effects'
                )

    async def load_kept_effects(self, case: Case, key: str) -> list[str]:
        """Load an effect file that is kept in a case; return the names of its effects."""
        try:
            content = effect_file(case, key)
        except UserError as error:
            self.say(str(error))
            return []
        return await self.load_effects(kept_effects(case)[key], content)

    async def load_effects(self, name: str, content: bytes) -> list[str]:
        """Add the effects of a file; every version is weighed anew. Return their names."""
        folder = self.cache.fresh_path()
        folder.mkdir()
        file = folder / (Path(name).name or 'my_effect.py')
        file.write_bytes(content)
        files = [*self.effect_files, file]
        found = await self._do('', tuple(files), tasks.effects_task, files)
        if found is None:
            return []
        new = [effect for effect in found if effect not in self.effects]
        self.effect_files, self.effects = files, found
        self._effect_homes |= dict.fromkeys(new, file)
        allow(self.cases, digest(content))
        for work in self.devices.values():
            work.found, work.failed = {}, set()
            for version in list(work.loaded):
                self.ask(work.name, version, anew=True)
        self.tell()
        return new

    async def _do(
        self, about: str, key: Any, function: Callable[..., Any], *arguments: Any
    ) -> Any:
        """Return the value of a task; None where it was cancelled or failed, which is said.

        `about`: device and version it is for.
        """
        try:
            show = partial(self.work, about=about)
            return await self.cache.compute(show, key, function, *arguments)
        except JobError as error:
            self.say(self._plain(str(error)))
        except JobCancelled:
            pass
        return None

    def _plain(self, text: str) -> str:
        """Return a message without the names of this server's own folders."""
        return text.replace(f'{self.cache.folder}/', '')
