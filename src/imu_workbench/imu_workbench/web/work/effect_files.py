# SPDX-License-Identifier: Apache-2.0
"""Effects of the user's own in a server: their files loaded, and kept in cases that need them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.effects import EFFECTS

from imu_workbench.case import Case, CaseError
from imu_workbench.case_effects import (
    allow,
    allowed_in,
    digest,
    effect_file,
    kept_effects,
    with_effect_file,
)
from imu_workbench.web.case import tasks
from imu_workbench.web.case.version import Version
from imu_workbench.web.work.task_runner import TaskRunner


class EffectFiles:
    """The effects a server knows: the catalogue's, and those of the files that were loaded."""

    def __init__(self, runner: TaskRunner, cases: Path, changed: Callable[[], None]) -> None:
        """`cases`: folder of the cases; `changed` is called when a file was loaded."""
        self.files: list[Path] = []
        self.explained: dict[str, dict[str, Any]] = tasks.effect_explanations(EFFECTS)
        """What `explain` says of every effect, by name."""
        self._homes: dict[str, Path] = {}
        """Effect of the user's own → its file."""
        self._runner, self._cases, self._changed = runner, cases, changed

    async def load(self, name: str, content: bytes) -> list[str]:
        """Add the effects of a file; return their names."""
        folder = self._runner.cache.fresh_path()
        folder.mkdir()
        file = folder / (Path(name).name or 'my_effect.py')
        file.write_bytes(content)
        files = [*self.files, file]
        found = await self._runner.run('effects', tuple(files), tasks.effects_task, files)
        if found is None:
            return []
        new = [effect for effect in found if effect not in self.explained]
        self.files, self.explained = files, found
        self._homes |= dict.fromkeys(new, file)
        allow(self._cases, digest(content))
        self._changed()
        return new

    async def load_kept(self, case: Case, key: str) -> list[str]:
        """Load an effect file that is kept in a case; return the names of its effects."""
        try:
            content = effect_file(case, key)
        except UserError as error:
            self._runner.notices.say(str(error))
            return []
        return await self.load(kept_effects(case)[key], content)

    async def load_allowed(self, case: Case) -> None:
        """Load the effect files of a case that were given to a server of these cases before."""
        for key in [key for key in kept_effects(case) if key in allowed_in(self._cases)]:
            await self.load_kept(case, key)

    def not_loaded(self, case: Case) -> dict[str, str]:
        """Return the effect files of a case that are not loaded: SHA-256 → name."""
        loaded = {digest(file.read_bytes()) for file in self.files}
        return {key: name for key, name in kept_effects(case).items() if key not in loaded}

    def check(self, case: Case, version: str, model_text: str) -> None:
        """Refuse a model whose effect file is kept in the case and not loaded."""
        for key, name in self.not_loaded(case).items():
            if key[:16] in model_text:  # as `source` of an effect names its file
                raise CaseError(
                    f'{version} needs {name}, which is kept in the case: load it below the '
                    'candidates (it runs code), or start the server with --effects'
                )

    def kept_for(self, case: Case, version: Version) -> Case:
        """Return the case with copies of the effect files that a version needs."""
        used = {name for names in version.effects.values() for name in names}
        for file in {self._homes[name] for name in used & {*self._homes}}:
            case = with_effect_file(case, file)
        return case
