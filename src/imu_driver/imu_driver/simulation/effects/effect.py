# SPDX-License-Identifier: Apache-2.0
"""A hidden effect of a simulated device: its law, its size, its truth.

The laws live on the simulated device's own nodes, fields and processes, finer than a catalogue of
effects would write them, so that naming and removing them proves something.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError

from imu_driver.simulation.devices import MEAN_STD
from imu_driver.simulation.run import DeviceRun

Waves: TypeAlias = list[dict[str, FloatArray]]
"""Per run: sensor → (n, 3) error before scaling, any unit as long as sensors are in proportion."""


@dataclass(frozen=True)
class Shape:
    """What a law returns: the errors before scaling, and the shape parameters it drew."""

    waves: Waves
    parameters: dict[str, float] = field(default_factory=dict)


LawFunction: TypeAlias = Callable[[Sequence[DeviceRun], str, np.random.Generator], Shape]


@dataclass(frozen=True)
class Law:
    """One hidden effect."""

    name: str
    sensors: tuple[str, ...]
    """What it may be hidden in; joined names mean both sensors at once."""
    function: LawFunction
    depends_on: tuple[str, ...] = ()
    """Variables of a law beyond the catalogue; any of them is a right answer."""
    place: Callable[[DeviceRun], DeviceRun] | None = None
    """Where the device stands for the law to act; None: as it does anyway."""


@dataclass(frozen=True)
class Truth:
    """What was hidden."""

    name: str | None
    """None: nothing in the catalogue describes it."""
    kind: str
    """'effect', 'data_quality', 'noise', 'unexplained', 'unlogged' or 'nothing'."""
    sensor: str | None = None
    magnitude: float = 0.0
    law: str = ''
    """Name of the law where `name` cannot tell."""
    depends_on: tuple[str, ...] = ()
    parameters: dict[str, float] = field(default_factory=dict)


def magnitude(runs: Sequence[DeviceRun], waves: Waves) -> float:
    """Return the rms of an effect over runs and axes of the sensors it is in.

    Per-run constants and one line in temperature per axis are projected out; the unit is the
    standard deviation of a one-second mean of each sensor (MEAN_STD).
    """
    warmth = [run.warmth - run.warmth.mean() for run in runs]
    spread = sum(float(w @ w) for w in warmth)
    total, count = 0.0, 0
    for sensor in waves[0]:
        parts = [(wave[sensor] - wave[sensor].mean(axis=0)) / MEAN_STD[sensor] for wave in waves]
        slope = np.sum([w @ part for w, part in zip(warmth, parts, strict=True)], axis=0) / spread
        for w, part in zip(warmth, parts, strict=True):
            left = part - np.multiply.outer(w, slope)
            total += float(np.sum(left * left))
            count += left.size
    return float(np.sqrt(total / count))


def hide(
    runs: Sequence[DeviceRun], law: Law, *, sensor: str, magnitude_wanted: float, seed: int
) -> tuple[list[DeviceRun], Truth]:
    """Return the runs with the effect added at exactly the magnitude wanted, and the truth."""
    if sensor not in law.sensors:
        raise UserError(
            f'{law.name} is not hidden in {sensor!r}; choose from {", ".join(law.sensors)}'
        )
    runs = [law.place(run) for run in runs] if law.place else runs
    shape = law.function(runs, sensor, np.random.default_rng((seed, 17)))
    size = magnitude(runs, shape.waves)
    if not size > 0.0:
        raise UserError(f'{law.name} does nothing in these runs: the profile does not excite it')
    factor = magnitude_wanted / size
    changed = []
    for run, wave in zip(runs, shape.waves, strict=True):
        hidden = {name: factor * values for name, values in wave.items()}
        errors = {
            name: values + hidden[name] if name in hidden else values
            for name, values in run.errors.items()
        }
        changed.append(replace(run, errors=errors, hidden=hidden))
    truth = Truth(
        name=None if law.depends_on else law.name,
        kind='unexplained' if law.depends_on else 'effect',
        sensor=sensor,
        magnitude=magnitude_wanted,
        law=law.name,
        depends_on=law.depends_on,
        parameters={**shape.parameters, 'scale': factor},
    )
    return changed, truth


def in_sensor(sensor: str, waves: Sequence[FloatArray], **parameters: float) -> Shape:
    """Return the shape of an effect of one sensor, one array (n, 3) per run."""
    return Shape([{sensor: wave} for wave in waves], parameters)


def axis_gains(generator: np.random.Generator) -> FloatArray:
    """Return (3,) gains of the axes, of either sign and within a factor of three."""
    gains: FloatArray = generator.choice([-1.0, 1.0], 3) * generator.uniform(0.5, 1.5, 3)
    return gains


def along_axes(values: FloatArray, gains: FloatArray) -> FloatArray:
    """Return (n, 3) one process (n,) with a gain per axis."""
    wave: FloatArray = np.multiply.outer(values, gains)
    return wave


def log_uniform(generator: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between two bounds."""
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))
