# SPDX-License-Identifier: Apache-2.0
"""One device as a server works on it: its case, and what is in memory of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from imu_workbench.case import Case
from imu_workbench.web.case.candidates import Candidate
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import timeline_of

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
    """Versions that could not be compared with the recordings, which was said."""

    @property
    def name(self) -> str:
        """The device."""
        return self.case.device

    def diagnosis(self, version: str) -> dict[str, Any] | None:
        """Return what was found of a version; None: not yet."""
        found = self.found.get(version)
        return found['diagnosis'] if found else None

    def candidates(self, version: str, sensor: str) -> list[Candidate]:
        """Return the candidates of a sensor, most probable first."""
        found = self.found.get(version) or {'candidates': {}}
        return [Candidate(**row) for row in found['candidates'].get(sensor, [])]

    def keep(self, name: str, version: Version) -> None:
        """Keep a version in memory; those unused for longest go."""
        self.loaded[name] = replace(version, timeline=timeline_of(self.bags))
        for old in list(self.loaded)[:-MAX_LOADED_VERSIONS]:
            del self.loaded[old]
