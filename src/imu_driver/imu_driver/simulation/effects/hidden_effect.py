# SPDX-License-Identifier: Apache-2.0
"""A hidden effect of the simulated device, and how it is added to runs.

The effects use the simulated device's own nodes, fields and processes, finer than thermal_comp's
catalogue and without an equation in common, so that naming them is a test of a diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray
from imu_recording.user_error import UserError

from imu_driver.simulation.devices import MEAN_STD
from imu_driver.simulation.run import DeviceRun

ALL_SENSORS = tuple(SENSOR_FIELDS)
PROOF_MASS = ('accelerometer', 'gyroscope')
"""Sensors with a moving mass."""
EXCITED_AT_REST = ('accelerometer', 'magnetometer')
"""Sensors whose input is not zero on a resting device."""

Errors: TypeAlias = dict[str, FloatArray]
"""Sensor → (n, 3) error of one run."""


@dataclass(frozen=True)
class ErrorShape:
    """Errors of an effect before they are scaled to a magnitude, and its shape parameters."""

    errors: list[Errors]
    """Per run, any unit as long as the sensors are in proportion."""
    parameters: dict[str, float] = field(default_factory=dict)


Runs: TypeAlias = Sequence[DeviceRun]
ShapeFunction: TypeAlias = Callable[[Runs, str, np.random.Generator], ErrorShape]
"""(runs, sensor, generator) → errors; draws the shape parameters from the generator."""


@dataclass(frozen=True)
class HiddenEffect:
    """An effect that a campaign can hide, with all that is known about it."""

    name: str
    """Name of the effect in thermal_comp's catalogue that describes it, if one does."""
    sensors: tuple[str, ...]
    """Sensors it can be hidden in; two names joined by + mean both at once."""
    shape: ShapeFunction
    kind: str = 'effect'
    """The right answer of a diagnosis: 'effect', 'noise', or 'unexplained' where no effect of the
    catalogue describes it."""
    depends_on: tuple[str, ...] = ()
    """Variables an unexplained effect depends on; any of them is a right answer."""
    logged_as: tuple[str, ...] = ()
    """Tracks that show its cause, the cause itself first; without them it is unlogged."""
    mounting: Callable[[DeviceRun], DeviceRun] | None = None
    """Puts the device where the effect acts; None: the effect acts anywhere."""


def hidden_effect(
    sensors: tuple[str, ...],
    *,
    kind: str = 'effect',
    depends_on: tuple[str, ...] = (),
    logged_as: tuple[str, ...] = (),
    mounting: Callable[[DeviceRun], DeviceRun] | None = None,
) -> Callable[[ShapeFunction], HiddenEffect]:
    """Make a function (runs, sensor, generator) → ErrorShape the hidden effect of its name."""

    def effect(shape: ShapeFunction) -> HiddenEffect:
        return HiddenEffect(
            name=shape.__name__,
            sensors=sensors,
            shape=shape,
            kind=kind,
            depends_on=depends_on,
            logged_as=logged_as,
            mounting=mounting,
        )

    return effect


@dataclass(frozen=True)
class Truth:
    """The effect, fault or lost channel that was hidden in a campaign."""

    name: str | None
    """Name in the catalogue; None: nothing there describes it."""
    kind: str
    """'effect', 'data_quality', 'noise', 'unexplained', 'unlogged' or 'nothing'."""
    sensor: str | None = None
    magnitude: float = 0.0
    law: str = ''
    """Name of the hidden effect, also where `name` is None."""
    depends_on: tuple[str, ...] = ()
    parameters: dict[str, float] = field(default_factory=dict)


LEAST_VISIBLE_SHARE = 0.03
"""Least share of an effect's error that a line in temperature must leave.

In a single pose a rotation or a scale error is nearly a line in temperature. Its small remainder,
from the thermometer's lag, must not be scaled up to a visible size: the effect itself would be
hundreds of times as large."""


def magnitude(runs: Runs, errors: Sequence[Errors]) -> float:
    """Return the rms of an effect's errors over runs and axes of the sensors it is in.

    Per-run constants and one line in temperature per axis are projected out; the unit is the
    standard deviation of a one-second mean of each sensor (MEAN_STD).
    """
    differences = [run.temperature_difference for run in runs]
    centred = [values - values.mean() for values in differences]
    spread = sum(float(t @ t) for t in centred)
    total, count = 0.0, 0
    for sensor in errors[0]:
        parts = [(run[sensor] - run[sensor].mean(axis=0)) / MEAN_STD[sensor] for run in errors]
        slope = np.sum([t @ part for t, part in zip(centred, parts, strict=True)], axis=0) / spread
        for t, part in zip(centred, parts, strict=True):
            left = part - np.multiply.outer(t, slope)
            total += float(np.sum(left * left))
            count += left.size
    return float(np.sqrt(total / count))


def add_hidden_effect(
    runs: Runs,
    effect: HiddenEffect,
    *,
    sensor: str,
    magnitude_wanted: float,
    seed: int,
    measured_on: Runs | None = None,
) -> tuple[list[DeviceRun], Truth]:
    """Return the runs with the effect added at exactly the magnitude wanted, and the truth.

    The magnitude is that in these runs, or in `measured_on`: runs of the device before it aged.
    """
    if sensor not in effect.sensors:
        raise UserError(
            f'{effect.name} cannot be hidden in {sensor!r}; choose from '
            f'{", ".join(effect.sensors)}'
        )

    runs, shape = _shape_in(runs, effect, sensor, seed)
    earlier, earlier_shape = runs, shape
    if measured_on:
        earlier, earlier_shape = _shape_in(measured_on, effect, sensor, seed)
    size = magnitude(earlier, earlier_shape.errors)
    if not size > 0.0:
        raise UserError(
            f'{effect.name} does nothing in these runs: the profile does not excite it'
        )
    if (visible := size / _rms(earlier_shape.errors)) < LEAST_VISIBLE_SHARE:
        raise UserError(
            f'{effect.name} cannot be seen in these runs: a line in temperature takes up all but '
            f'{100.0 * visible:.2g} % of it; record more orientations or cycles'
        )
    factor = magnitude_wanted / size
    changed = [
        _with_errors(run, {name: factor * values for name, values in errors.items()})
        for run, errors in zip(runs, shape.errors, strict=True)
    ]
    truth = Truth(
        name=None if effect.kind == 'unexplained' else effect.name,
        kind=effect.kind,
        sensor=sensor,
        magnitude=magnitude_wanted,
        law=effect.name,
        depends_on=effect.depends_on,
        parameters={**shape.parameters, 'scale': factor},
    )
    return changed, truth


def _shape_in(
    runs: Runs, effect: HiddenEffect, sensor: str, seed: int
) -> tuple[list[DeviceRun], ErrorShape]:
    """Return the runs with the device mounted where the effect acts, and the effect's shape."""
    mounted = [effect.mounting(run) for run in runs] if effect.mounting else list(runs)
    return mounted, effect.shape(mounted, sensor, np.random.default_rng((seed, 17)))


def _rms(errors: Sequence[Errors]) -> float:
    """Return the rms of errors about the mean of each run, in the unit of `magnitude`."""
    parts = [
        (run[sensor] - run[sensor].mean(axis=0)) / MEAN_STD[sensor]
        for run in errors
        for sensor in run
    ]
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _with_errors(run: DeviceRun, hidden: Errors) -> DeviceRun:
    errors = {
        name: values + hidden[name] if name in hidden else values
        for name, values in run.errors.items()
    }
    together = {name: run.hidden.get(name, 0.0) + values for name, values in hidden.items()}
    return replace(run, errors=errors, hidden={**run.hidden, **together})


def in_sensor(sensor: str, errors: Sequence[FloatArray], **parameters: float) -> ErrorShape:
    """Return the shape of an effect in one sensor, one array (n, 3) per run."""
    return ErrorShape([{sensor: values} for values in errors], parameters)


def axis_gains(generator: np.random.Generator) -> FloatArray:
    """Return (3,) gains of the axes, of either sign and within a factor of three."""
    gains: FloatArray = generator.choice([-1.0, 1.0], 3) * generator.uniform(0.5, 1.5, 3)
    return gains


def along_axes(values: FloatArray, gains: FloatArray) -> FloatArray:
    """Return (n, 3) one process (n,) with a gain per axis."""
    errors: FloatArray = np.multiply.outer(values, gains)
    return errors


def log_uniform(generator: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between two bounds."""
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))
