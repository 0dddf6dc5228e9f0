# SPDX-License-Identifier: Apache-2.0
"""One tab's session: its devices, the versions of their models, and the user's actions."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.data.motion import left_out_note
from thermal_comp.effects import EFFECTS
from thermal_comp.experiment.design import Limits
from thermal_comp.presentation.display import SENSORS

from imu_workbench.web.case import tasks
from imu_workbench.web.case.next_experiment import next_profile_task
from imu_workbench.web.case.preview import EffectPreview, preview_task
from imu_workbench.web.case.stored_bag import StoredBag, with_unique_runs
from imu_workbench.web.case.tasks import effect_explanations, effects_task, report_task
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import Place, View
from imu_workbench.web.jobs import JobCancelled, JobError, Stoppable
from imu_workbench.web.result_cache import ResultCache, file_key


@dataclass
class DeviceState:
    """One device: its runs and its models."""

    name: str
    bags: list[StoredBag]
    prepared: Path
    versions: list[Version] = field(default_factory=list)
    current: int = 0
    """The version the plots show."""
    earlier: int | None = None
    """Version whose residual is drawn for comparison."""
    problem: str = ''
    """Why there is no model."""
    unusable: dict[str, str] = field(default_factory=dict)
    """Effect → why it cannot be fitted to these runs."""
    diagnoses: dict[str, dict[str, Any]] = field(default_factory=dict)
    """By the text of the model file."""

    @property
    def version(self) -> Version | None:
        """The version shown; None before the first."""
        return self.versions[self.current] if self.versions else None

    @property
    def earlier_version(self) -> Version | None:
        """The version compared with."""
        return None if self.earlier is None else self.versions[self.earlier]

    @property
    def diagnosis(self) -> dict[str, Any] | None:
        """The diagnosis of the version shown; None before it."""
        return self.diagnoses.get(self.version.model_text) if self.version else None

    def append(self, version: Version) -> None:
        """Make a version that follows the one shown; those after it are dropped."""
        before = self.current
        kept = self.versions[: self.current + 1]
        self.versions = [*kept, version]
        self.current = len(self.versions) - 1
        self.earlier = before if self.current else None

    def undo(self) -> None:
        """Go back one version and drop the one left."""
        if len(self.versions) > 1 and self.current > 0:
            self.versions = self.versions[: self.current]
            self.current -= 1
            self.earlier = self.current - 1 if self.current else None


@dataclass
class Session:
    """The state of one tab."""

    devices: dict[str, DeviceState] = field(default_factory=dict)
    device: str = ''
    view: View = field(default_factory=lambda: View('accelerometer'))
    effect_files: list[Path] = field(default_factory=list)
    """The user's own effects, beside the catalogue."""
    effects: dict[str, dict[str, Any]] = field(
        default_factory=lambda: effect_explanations(EFFECTS)
    )
    """What `explain` says of every effect, by name."""

    @property
    def state(self) -> DeviceState | None:
        """The device looked at."""
        return self.devices.get(self.device)

    @property
    def version(self) -> Version | None:
        """The model looked at."""
        return self.state.version if self.state else None

    @property
    def nothing_yet(self) -> str:
        """Text where there is no model: what to do, or why."""
        if self.state is None:
            return 'Nothing to look at yet: choose recordings with “Open bags” above.'
        return self.state.problem or 'The first model is being fitted …'

    def sensors(self) -> list[str]:
        """Return the sensors of the model looked at, in the order of the tables."""
        known = self.version.comparison['sensors'] if self.version else {}
        return [sensor for sensor in SENSORS if sensor in known]

    def look_at(self, **changes: Any) -> None:
        """Change what is looked at: sensor, axis, place."""
        self.view = replace(self.view, **changes)

    def look_at_worst(self) -> None:
        """Look at the sensor and axis that are furthest above their noise floor."""
        if self.version is None:
            return
        ratios = {
            (sensor, axis): (error or 0.0) / floor
            for sensor, part in self.version.comparison['sensors'].items()
            for axis, (error, floor) in enumerate(
                zip(part['held_out_rms'], part['noise_floor'], strict=True)
            )
            if floor
        }
        if ratios:
            sensor, axis = max(ratios, key=lambda key: ratios[key])
            self.view = View(sensor, axis)

    def go_to(self, place: Place | None) -> None:
        """Look at a place; the same again, or None, looks at everything."""
        self.look_at(place=None if place == self.view.place else place)


@dataclass(frozen=True)
class Display:
    """How a tab shows its work and its messages."""

    work: Callable[[Stoppable], AbstractContextManager[None]]
    say: Callable[[str], None]


class WorkbenchTab:
    """Actions of the user; one that fails says so on the page and changes nothing."""

    def __init__(
        self, cache: ResultCache, display: Display, remap: Mapping[str, str] | None = None
    ) -> None:
        self.cache = cache
        self._remap = dict(remap or {})
        self.session = Session()
        self._display = display

    async def open_bags(
        self, paths: Sequence[str | Path], read: Callable[[], Awaitable[None]]
    ) -> bool:
        """Read bags and make their devices known; True where there are new ones.

        `read` is called after every bag, so that the page shows it at once.
        """
        first = ''
        for path in paths:
            found = await self._read(path)
            known = {bag.folder for state in self.session.devices.values() for bag in state.bags}
            moving = [bag for bag in found if bag.motion]
            for bag in moving:
                self._display.say(left_out_note(bag.run, bag.motion))
            found = [bag for bag in found if bag not in moving]
            new = [bag for bag in found if bag.folder not in known]
            for device in dict.fromkeys(bag.device for bag in new):
                before = self.session.devices.get(device)
                own = [b for b in new if b.device == device]
                bags = with_unique_runs([*(before.bags if before else ()), *own])
                prepared = self.cache.prepared_path(bags)
                self.session.devices[device] = DeviceState(device, bags, prepared)
                if not first:
                    first = self.session.device = device
            if new:
                await read()
            elif found:
                self._display.say(f'{path}: open already')
        return bool(first)

    async def _read(self, path: str | Path) -> list[StoredBag]:
        try:
            located = self.cache.root.locate(path)
        except UserError as error:
            self._display.say(str(error))
            return []
        folder = self.cache.fresh_path()
        try:
            async with self.cache.exclusive(self.cache.reading, self._display.work):
                found = await self._do(
                    file_key(located), tasks.read_task, located, folder, self._remap
                )
        except JobCancelled:
            return []
        return found or []

    async def first_version(self, model_text: str | None = None) -> bool:
        """Fit the line, or take the given model, as the next version; True where it worked."""
        state = self.session.state
        if state is None:
            return False
        files = list(self.session.effect_files)
        key = (str(state.prepared), model_text, tuple(files))
        arguments = (state.bags, state.prepared, model_text, files)
        found = await self._do(key, tasks.first_version_task, *arguments)
        if found is None:
            state.problem = 'There is no model of these bags: see the message above.'
            return False
        version, state.unusable, left_out = found
        for bag in [bag for bag in state.bags if bag.run in left_out]:
            self._display.say(f'{left_out[bag.run]}; it is left out')
            state.bags.remove(bag)
        state.append(version)
        self.session.look_at_worst()
        return True

    async def change(self, change: tasks.Change) -> bool:
        """Add an effect, or take it out, and refit."""
        state = self.session.state
        if state is None or state.version is None:
            return False
        before, files = state.version, list(self.session.effect_files)
        key = (str(state.prepared), before.model_text, change, tuple(files))
        arguments = (state.prepared, before.model_text, change, files)
        version = await self._do(key, tasks.change_task, *arguments)
        if version is None or state.version is not before:
            return False
        state.append(version)
        return True

    async def diagnose(self) -> bool:
        """Diagnose the version looked at."""
        state = self.session.state
        if state is None or state.version is None:
            return False
        text, files = state.version.model_text, list(self.session.effect_files)
        key = (str(state.prepared), text, tuple(files))
        found = await self._do(key, tasks.diagnose_task, state.bags, text, files)
        if found is not None:
            state.diagnoses[text] = found
        return found is not None

    async def preview(self, effect: str, sensor: str) -> EffectPreview | None:
        """Return what an effect would explain of the version looked at."""
        state = self.session.state
        if state is None or state.version is None:
            return None
        text, files = state.version.model_text, list(self.session.effect_files)
        key = (str(state.prepared), text, effect, sensor, tuple(files))
        arguments = (state.prepared, text, effect, sensor, files)
        found: EffectPreview | None = await self._do(key, preview_task, *arguments)
        return found

    async def next_profile(self, one: str, other: str) -> dict[str, Any] | None:
        """Return the experiment that tells two effects apart."""
        version = self.session.version
        if version is None:
            return None
        files = list(self.session.effect_files)
        key = (version.model_text, one, other, tuple(files))
        arguments = (version.model_text, (one, other), Limits(), files)
        found: dict[str, Any] | None = await self._do(key, next_profile_task, *arguments)
        return found

    async def report(self) -> Path | None:
        """Write the report of the device looked at."""
        state = self.session.state
        if state is None or state.version is None:
            return None
        text, files = state.version.model_text, list(self.session.effect_files)
        key = (str(state.prepared), text, tuple(files))
        target = self.cache.fresh_path('.html')
        models = {state.name: text}
        found: Path | None = await self._do(key, report_task, state.bags, models, files, target)
        return found

    async def load_effects(self, name: str, content: bytes) -> bool:
        """Add the effects of a file to those of the session."""
        folder = self.cache.fresh_path()
        folder.mkdir()
        file = folder / (Path(name).name or 'my_effect.py')
        file.write_bytes(content)
        files = [*self.session.effect_files, file]
        found = await self._do(tuple(files), effects_task, files)
        if found is None:
            return False
        self.session.effect_files = files
        self.session.effects = found
        return True

    async def _do(self, key: Any, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the value of a task; None where it was cancelled or failed, which is said."""
        try:
            return await self.cache.compute(self._display.work, key, function, *arguments)
        except JobError as error:
            self._display.say(str(error).replace(f'{self.cache.folder}/', ''))
        except JobCancelled:
            pass
        return None
