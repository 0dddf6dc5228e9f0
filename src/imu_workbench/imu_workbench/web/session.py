# SPDX-License-Identifier: Apache-2.0
"""What one tab works on: its devices, the versions of their models, where it looks."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from imu_workbench.display import SENSORS
from imu_workbench.web.stored_bag import StoredBag
from imu_workbench.web.version import Version
from imu_workbench.web.view import Place, View


@dataclass
class DeviceState:
    """One device: its runs and its models."""

    name: str
    bags: list[StoredBag]
    prepared: Path
    versions: list[Version] = field(default_factory=list)
    current: int = 0
    """Version the plots show."""
    earlier: int | None = None
    """Version whose residual is drawn for comparison."""
    problem: str = ''
    """Why there is no model."""
    greyed: dict[str, str] = field(default_factory=dict)
    diagnoses: dict[str, dict[str, Any]] = field(default_factory=dict)
    """By model file."""

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
        """What was said about the version shown."""
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
        """Why there is no model to look at."""
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
