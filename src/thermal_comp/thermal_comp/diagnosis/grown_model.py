# SPDX-License-Identifier: Apache-2.0
"""A grown model: the steps it took, and what each did to the held-out error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from thermal_comp.comparison.compare import Comparison, SensorComparison, rms_of
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import falls, parts_that_fall
from thermal_comp.diagnosis.result import Diagnosis, Prediction
from thermal_comp.model.values import ThermalModel, fitted_shapes
from thermal_comp.presentation.notebook import Presented


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added; rms over the sensors' axes, held out, in the sensor's unit."""

    added: str
    """Names, with + between several; '' where effects were only left out."""
    sensors: tuple[Sensor, ...]
    error_before: float
    error_after: float
    noise_floor: float
    ambiguous_with: tuple[str, ...] = ()
    empirical: bool = False
    """Whether no cause is decided: what was added only lowers the error on held-out parts."""
    lowered: bool = True
    """Whether the held-out error falls by more than chance."""
    parts: int = 0
    """Parts that were held out in turn."""
    parts_lowered: int = 0
    """Those of them whose error falls."""
    replaced: tuple[str, ...] = ()
    """Effects that were left out for it."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            'added': self.added,
            'sensor': '+'.join(self.sensors),
            'error_before': self.error_before,
            'error_after': self.error_after,
            'noise_floor': self.noise_floor,
            'ambiguous_with': list(self.ambiguous_with),
            'empirical': self.empirical,
            'lowered': self.lowered,
            'parts': self.parts,
            'parts_lowered': self.parts_lowered,
            'replaced': list(self.replaced),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Growth(Presented):
    """A grown model and how it came about."""

    presentation = 'growth'

    model: ThermalModel
    before: Comparison
    after: Comparison
    steps: tuple[Step, ...]
    unneeded: tuple[str, ...] = ()
    """`sensor: effect` of terms the others make superfluous."""
    worse: tuple[str, ...] = ()
    """Where a line, or no model at all, leaves less on held-out parts."""
    diagnosis: Diagnosis | None = None
    """What is said about the grown model; None where it was not asked for."""

    @property
    def predictions(self) -> tuple[Prediction, ...]:
        """What the grown model leaves of each sensor's error."""
        made = []
        for sensor, before in self.before.sensors.items():
            after = self.after.sensors[sensor]
            steps = [step for step in self.steps if sensor in step.sensors]
            terms: list[str] = []
            for step in steps:
                terms = [name for name in terms if name not in step.replaced]
                terms += step.added.split(' + ') if step.added else []
            made.append(
                Prediction(
                    sensor,
                    tuple(terms),
                    rms_of(before.held_out_rms),
                    rms_of(after.held_out_rms),
                    rms_of(after.noise_floor),
                    any(step.empirical for step in steps),
                )
            )
        return tuple(made)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: the comparison after growing, and the steps to it."""
        return self.after.to_dict() | {
            'steps': [step.to_dict() for step in self.steps],
            'prediction': {p.sensor: p.to_dict() for p in self.predictions},
            'parameters': fitted_shapes(self.model),
            'unneeded': list(self.unneeded),
            'worse': list(self.worse),
            'undetermined': list(self.model.provenance.notes),
        }


def step_of(
    before: SensorComparison,
    after: SensorComparison,
    added: str,
    sensors: tuple[Sensor, ...],
    ambiguous_with: tuple[str, ...],
    empirical: bool,
    replaced: tuple[str, ...],
) -> Step:
    """Return the step the held-out error takes on the first of the sensors."""
    squares = before.held_out_squares, after.held_out_squares, after.noise_floor**2
    return Step(
        added=added,
        sensors=sensors,
        error_before=rms_of(before.held_out_rms),
        error_after=rms_of(after.held_out_rms),
        noise_floor=rms_of(after.noise_floor),
        ambiguous_with=ambiguous_with,
        empirical=empirical,
        lowered=falls(*squares),
        parts=len(after.held_out_squares),
        parts_lowered=parts_that_fall(*squares),
        replaced=replaced,
    )
