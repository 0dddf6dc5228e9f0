# SPDX-License-Identifier: Apache-2.0
"""What a campaign can hide: a physical effect, an unlogged channel, a clock, a data fault."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, ImuRecording
from imu_recording.user_error import UserError

from imu_driver.simulation.data_faults import FAULTS, saturate
from imu_driver.simulation.effects import chamber as simulated_effects_chamber
from imu_driver.simulation.effects import heat as simulated_effects_heat
from imu_driver.simulation.effects import session as simulated_effects_session
from imu_driver.simulation.effects import uncatalogued as simulated_effects_beyond
from imu_driver.simulation.effects.effect import Law, Truth, hide
from imu_driver.simulation.run import DeviceRun

LAWS: dict[str, Law] = {
    law.name: law
    for module in (
        simulated_effects_heat,
        simulated_effects_session,
        simulated_effects_chamber,
        simulated_effects_beyond,
    )
    for law in module.LAWS
}
"""Name → law."""

CHANNEL_OF = {
    'heater_hard_iron': ('heater',),
    'compressor_hard_iron': ('compressor',),
    'supply_sensitivity': ('supply_voltage',),
    'vibration_rectification': ('vibration', 'compressor'),
    'humidity': ('humidity',),
}
"""Laws that can be hidden with the logs that would betray them taken away; first: what it is."""


Finish: TypeAlias = Callable[[list[ImuRecording]], list[ImuRecording]]

UNLOGGED = tuple(f'unlogged_{channels[0]}' for channels in CHANNEL_OF.values())
QUALITY = ('saturation', 'startup_transient', *FAULTS)
NOTHING = 'nothing'
CLOCK = 'clock_temperature'
HIDEABLE = (*LAWS, CLOCK, *UNLOGGED, *QUALITY, NOTHING)
"""Everything that can be hidden, by name."""
CLOCK_SLOPE = 20e-6
"""Change of the clock's rate per kelvin and unit of magnitude [1/K]."""


def _as_made(recordings: list[ImuRecording]) -> list[ImuRecording]:
    return recordings


@dataclass(frozen=True)
class Hidden:
    """A campaign with something hidden in it."""

    runs: list[DeviceRun]
    truth: Truth
    finish: Finish = field(default=_as_made)
    """What still happens to the finished recordings."""
    startup_time: float = 0.0
    """Start-up transient of the read-out [s]."""


def hide_anything(
    runs: Sequence[DeviceRun],
    name: str,
    *,
    magnitude: float,
    seed: int,
    sensor: str | None = None,
) -> Hidden:
    """Return the campaign with `name` hidden in it; without `sensor` the seed chooses one."""
    generator = np.random.default_rng((seed, 23))
    if name == NOTHING:
        return Hidden(list(runs), Truth(None, 'nothing', law=name))
    if name in LAWS:
        return _hide_law(runs, name, magnitude, seed, _chosen(LAWS[name].sensors, sensor, seed))
    if name == CLOCK:
        slope = float(generator.choice([-1.0, 1.0])) * CLOCK_SLOPE * magnitude
        truth = Truth(
            name, 'effect', 'all', magnitude, name, parameters={'relative_rate_per_kelvin': slope}
        )
        return Hidden([replace(run, rate_slope=slope) for run in runs], truth)
    if name in UNLOGGED:
        return _hide_unlogged(runs, name, magnitude, seed, sensor)
    if name in QUALITY:
        return _hide_fault(runs, name, magnitude, seed, sensor)
    raise UserError(f'{name!r} cannot be hidden; choose from {", ".join(HIDEABLE)}, random')


def random_name(seed: int) -> str:
    """Return what 'random' hides: mostly effects, sometimes nothing, a fault, a missing log."""
    generator = np.random.default_rng((seed, 29))
    in_catalogue = [name for name, law in LAWS.items() if not law.depends_on]
    beyond = [name for name, law in LAWS.items() if law.depends_on]
    kinds = (in_catalogue, beyond, list(UNLOGGED), list(QUALITY), [CLOCK], [NOTHING])
    kind = kinds[int(generator.choice(len(kinds), p=[0.68, 0.08, 0.06, 0.06, 0.02, 0.10]))]
    return str(generator.choice(kind))


def _chosen(sensors: Sequence[str], sensor: str | None, seed: int) -> str:
    if sensor is None:
        return str(np.random.default_rng((seed, 31)).choice(list(sensors)))
    if sensor not in sensors:
        raise UserError(f'--sensor {sensor}: this one hides in {", ".join(sensors)}')
    return sensor


def _hide_law(
    runs: Sequence[DeviceRun], name: str, magnitude: float, seed: int, sensor: str
) -> Hidden:
    changed, truth = hide(runs, LAWS[name], sensor=sensor, magnitude_wanted=magnitude, seed=seed)
    if name == 'random_walk':
        truth = replace(truth, kind='noise')
    return Hidden(changed, truth)


def _hide_unlogged(
    runs: Sequence[DeviceRun], name: str, magnitude: float, seed: int, sensor: str | None
) -> Hidden:
    """Hide an effect together with the logs that would explain it."""
    law, channels = next(
        (law, channels)
        for law, channels in CHANNEL_OF.items()
        if channels[0] == name.removeprefix('unlogged_')
    )
    hidden = _hide_law(runs, law, magnitude, seed, _chosen(LAWS[law].sensors, sensor, seed))
    blank: dict[str, Any] = dict.fromkeys(channels)
    truth = replace(
        hidden.truth,
        name=None,
        kind='unlogged',
        depends_on=(name.removeprefix('unlogged_').removesuffix('_voltage'), 'chamber'),
    )
    return Hidden(
        hidden.runs,
        truth,
        lambda recordings: [replace(recording, **blank) for recording in recordings],
    )


def _hide_fault(
    runs: Sequence[DeviceRun], name: str, magnitude: float, seed: int, sensor: str | None
) -> Hidden:
    if name == 'startup_transient':
        truth = Truth(name, 'data_quality', 'all', magnitude, name)
        return Hidden(list(runs), truth, startup_time=60.0 + 30.0 * magnitude)
    if name == 'orientation_flip':
        chosen = 'accelerometer'
    else:
        chosen = _chosen(tuple(SENSOR_FIELDS), sensor, seed)
    truth = Truth(name, 'data_quality', chosen, magnitude, name)
    if name == 'saturation':
        return Hidden(saturate(runs, chosen, magnitude), truth)
    fault = FAULTS[name]

    def finish(recordings: list[ImuRecording]) -> list[ImuRecording]:
        generator = np.random.default_rng((seed, 37))
        return fault(recordings, chosen, magnitude, generator)

    return Hidden(list(runs), truth, finish)
