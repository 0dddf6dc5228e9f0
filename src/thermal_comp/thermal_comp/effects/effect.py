# SPDX-License-Identifier: Apache-2.0
"""What a physical effect is: columns whose linear combination is its error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Literal

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import SENSORS, Conditions, Sensor

State = Any
"""History an effect carries from one piece of a stream to the next: a tuple of plain numbers."""


def shape_parameter(
    default: float | tuple[float, ...], *, unit: str, bounds: tuple[float, float]
) -> Any:
    """Declare a nonlinear parameter of an effect: default, unit and bounds of every value."""
    return field(default=default, metadata={'unit': unit, 'bounds': bounds})


@dataclass(frozen=True)
class Effect:
    """One physical effect: subclass as a frozen dataclass whose fields are shape parameters.

    The class attributes describe it; `explain` and doc/physics.md print them. Device effects
    belong to the sensor, are causal and are compensated in the field; campaign effects belong to
    chamber, fixture or session and are fitted only so that they do not spoil the coefficients.
    """

    name: ClassVar[str] = ''
    """Catalogue key = key in the model file = label in reports."""
    kind: ClassVar[Literal['device', 'campaign']] = 'device'
    sensors: ClassVar[tuple[Sensor, ...]] = SENSORS
    """Sensors it can act on."""
    coupled: ClassVar[bool] = False
    """True where the sensors share one set of coefficients."""
    per_run: ClassVar[bool] = False
    """True where every run has coefficients of its own."""
    channels: ClassVar[tuple[str, ...]] = ()
    """Channels of Conditions it needs beyond time, die temperature and the true inputs."""
    optional_channels: ClassVar[tuple[str, ...]] = ()
    """Channels it makes use of where they were logged."""
    equation: ClassVar[str] = ''
    """error = …, with units."""
    coefficient_units: ClassVar[tuple[str, ...]] = ()
    """Unit of each column's coefficient; {unit} stands for the sensor's SI unit."""
    mechanism: ClassVar[str] = ''
    look_alikes: ClassVar[tuple[str, ...]] = ()
    separation: ClassVar[str] = ''
    """How to tell it from its look-alikes."""
    typical_size: ClassVar[str] = ''
    reference: ClassVar[str] = ''
    """Standard, datasheet or paper."""

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return the columns for the samples and the history for the samples after them.

        (n, p): each axis has its own p coefficients; (n, 3, p): p coefficients shared by the axes.
        `state` None starts the history at the first sample.
        """
        raise NotImplementedError

    def columns_in_hindsight(self, conditions: Conditions) -> FloatArray:
        """Return the columns for a run that is known to its end, of a smoothed temperature.

        What a diagnosis compares: an effect that must smooth or delay to be causal overrides it.
        """
        return self.columns(conditions)[0]

    @property
    def shape_parameters(self) -> dict[str, Any]:
        """Shape parameters by name."""
        return {item.name: getattr(self, item.name) for item in fields(self)}


def joined_effects(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """Return the effects with the values of repeated ones joined: several steps are one effect."""
    joined: dict[str, Effect] = {}
    for effect in effects:
        before = joined.get(effect.name)
        if before is not None:
            values = {
                name: tuple(sorted({*value, *before.shape_parameters[name]}))
                for name, value in effect.shape_parameters.items()
                if isinstance(value, tuple)
            }
            joined[effect.name] = replace(before, **values)
        else:
            joined[effect.name] = effect
    return tuple(joined.values())
