# SPDX-License-Identifier: Apache-2.0
"""One device as a server works on it: its case, and what is in memory of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from imu_workbench.case import Case, CaseRecording, known_recordings, saved
from imu_workbench.web.case.candidates import EffectCandidate
from imu_workbench.web.case.stored_bag import StoredBag, with_unique_runs
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import timeline_of
from imu_workbench.web.work.result_cache import ResultCache

MAX_LOADED_VERSIONS = 12
"""Versions whose block means are kept in memory, per device."""


@dataclass
class DeviceWork:
    """One device: its case, its recordings as they were read, its versions as they are drawn."""

    case: Case
    bags: list[StoredBag] = field(default_factory=list)
    prepared: Path = Path()
    loaded: dict[str, Version] = field(default_factory=dict)
    found: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Version → diagnosis and candidates."""
    unusable: dict[str, str] = field(default_factory=dict)
    """Effect → why it cannot be fitted to these runs."""
    left_out: dict[str, str] = field(default_factory=dict)
    """Run → why it is left out."""
    problem: str = ''
    """Why there is no model."""
    failed: set[str] = field(default_factory=set)
    """Versions that could not be compared with the recordings; a message said why."""

    @property
    def name(self) -> str:
        """The device."""
        return self.case.device

    def diagnosis(self, version: str) -> dict[str, Any] | None:
        """Return what was found of a version; None: not yet."""
        found = self.found.get(version)
        return found['diagnosis'] if found else None

    def candidates(self, version: str, sensor: str) -> list[EffectCandidate]:
        """Return the candidates of a sensor, most probable first."""
        found = self.found.get(version) or {'candidates': {}}
        return [EffectCandidate(**row) for row in found['candidates'].get(sensor, [])]

    def keep(self, name: str, version: Version) -> None:
        """Keep a version in memory; those unused for longest go."""
        self.loaded[name] = replace(version, timeline=timeline_of(self.bags))
        for old in list(self.loaded)[:-MAX_LOADED_VERSIONS]:
            del self.loaded[old]

    def take_bags(self, bags: Sequence[StoredBag], cache: ResultCache) -> None:
        """Work on these recordings as they were read; the case keeps its others."""
        self.bags = with_unique_runs(bags)
        hashes = {r.run: r.sha256 for r in self.case.recordings}
        read = [
            CaseRecording(b.source, b.run, hashes.get(b.run, ''), b.samples, True, *b.file_state)
            for b in self.bags
        ]
        runs = {bag.run for bag in self.bags}
        self.keep_recordings([*read, *(r for r in self.case.recordings if r.run not in runs)])
        self.prepared = cache.prepared_path(self.bags)
        self.loaded, self.failed, self.problem = {}, set(), ''

    def close_unread(self) -> None:
        """Mark recordings that were not read as closed."""
        runs = {bag.run for bag in self.bags}
        self.keep_recordings(
            r if r.run in runs else replace(r, open=False) for r in self.case.recordings
        )

    def keep_recordings(self, recordings: Iterable[CaseRecording]) -> None:
        """Save the recordings; what was found in others is forgotten."""
        before = known_recordings(self.case)
        self.case = saved(replace(self.case, recordings=tuple(recordings)))
        if known_recordings(self.case) != before:
            self.found = {}
