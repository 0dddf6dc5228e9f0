# SPDX-License-Identifier: Apache-2.0
"""The diagnosis of one device's model and what adding effects would bring, as a task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from thermal_comp.data_quality import check_quality
from thermal_comp.diagnose import Settings, diagnose
from thermal_comp.diagnose_growth import grow
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.model import ModelError, ThermalModel
from thermal_comp.preparation import prepare

from imu_recording import ImuRecording


@dataclass(frozen=True, eq=False)
class DiagnosisTask:
    """The recordings of one device and the model to be judged."""

    device: str
    recordings: Sequence[ImuRecording]
    model: ThermalModel
    catalogue: Mapping[str, type[Effect]] = field(default_factory=lambda: EFFECTS)

    @property
    def label(self) -> str:
        """What is diagnosed."""
        return f'diagnosing {self.device}'

    @property
    def size(self) -> float:
        """As long as filtering so many rows [10⁶]."""
        return 3.0 + 1.5e-6 * sum(map(len, self.recordings))

    def run(self) -> dict[str, Any]:
        """Return the diagnosis as plain values, with `steps` where effects can be added.

        Where the recordings cannot be diagnosed, `problem` says why and nothing else is there.
        """
        try:
            content = diagnose(self.recordings, self.model, catalogue=self.catalogue).content()
        except ModelError as error:
            return {'device': self.device, 'problem': f'not diagnosed: {error}'}
        steps: list[dict[str, Any]] = []
        if any(finding['kind'] == 'effect' for finding in content['findings']):
            runs = prepare(check_quality(self.recordings)[0])
            steps = [
                step.content() for step in grow(self.model, runs, Settings(self.catalogue)).steps
            ]
        return content | {'steps': steps}
