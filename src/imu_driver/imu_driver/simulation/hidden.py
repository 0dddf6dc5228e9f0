# SPDX-License-Identifier: Apache-2.0
"""Everything a campaign can hide: physical effects, unlogged channels, a clock, data faults."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, ImuRecording
from imu_recording.user_error import UserError, did_you_mean

from imu_driver.simulation.data_faults import FAULTS, saturate
from imu_driver.simulation.effects import bias_in_time, chamber, exposure, heat, uncatalogued
from imu_driver.simulation.effects.hidden_effect import HiddenEffect, Truth, add_hidden_effect
from imu_driver.simulation.run import DeviceRun

HIDDEN_EFFECTS: dict[str, HiddenEffect] = {
    effect.name: effect
    for effect in (
        heat.bias_temperature_curvature,
        heat.scale_factor_temperature,
        heat.misalignment_temperature,
        heat.g_sensitivity_temperature,
        heat.thermal_lag,
        heat.thermal_lag_two_stage,
        heat.temperature_rate,
        heat.thermal_gradient,
        heat.thermal_hysteresis,
        bias_in_time.warm_up,
        exposure.supply_sensitivity,
        exposure.vibration_rectification,
        exposure.humidity,
        exposure.icing,
        bias_in_time.turn_on_bias,
        bias_in_time.bias_step,
        bias_in_time.bias_drift,
        bias_in_time.bias_creep,
        bias_in_time.random_walk,
        chamber.heater_hard_iron,
        chamber.compressor_hard_iron,
        chamber.fixture_hard_iron,
        chamber.fixture_tilt,
        chamber.mains_alias,
        uncatalogued.mode_crossing,
        uncatalogued.resonance_comb,
        uncatalogued.ageing_slope,
        uncatalogued.room_rhythm,
    )
}
"""Name → effect. `random_name` draws by position: another order gives seeds other effects."""

CLOCK_TEMPERATURE = 'clock_temperature'
UNLOGGED_EFFECTS = {
    f'unlogged_{effect.logged_as[0]}': effect
    for effect in (
        chamber.heater_hard_iron,
        chamber.compressor_hard_iron,
        exposure.supply_sensitivity,
        exposure.vibration_rectification,
        exposure.humidity,
    )
}
"""Name → effect that is hidden together with the tracks that show its cause."""
DATA_FAULTS = ('saturation', 'startup_transient', *FAULTS)
"""Faults of the data."""
NOTHING = 'nothing'
HIDEABLE = (*HIDDEN_EFFECTS, CLOCK_TEMPERATURE, *UNLOGGED_EFFECTS, *DATA_FAULTS, NOTHING)
"""Everything that can be hidden, by name."""

CLOCK_SLOPE = 20e-6
"""Change of the clock's rate per kelvin and unit of magnitude [1/K]."""

Finish: TypeAlias = Callable[[list[ImuRecording]], list[ImuRecording]]


def _unchanged(recordings: list[ImuRecording]) -> list[ImuRecording]:
    return recordings


@dataclass(frozen=True)
class Hidden:
    """A campaign with something hidden in it."""

    runs: list[DeviceRun]
    truth: Truth
    """Of an effect whose cause was logged; else as `as_recorded` says."""
    finish: Finish = field(default=_unchanged)
    """Applied to the finished recordings."""
    startup_time: float = 0.0
    """Start-up transient of the read-out [s]."""


def check_hideable(name: str, own: Collection[str] = ()) -> None:
    """Raise UserError where neither the simulator nor `own` has anything of this name to hide."""
    if name not in HIDEABLE and name not in own:
        raise UserError(
            f'the simulator cannot hide {name!r}{did_you_mean(name, HIDEABLE)}: it has '
            'physics of its own for every effect '
            f'(imu_driver/simulation/effects) and knows {", ".join(HIDEABLE)}'
        )


def hide_anything(
    runs: Sequence[DeviceRun],
    name: str,
    *,
    magnitude: float,
    seed: int,
    sensor: str | None = None,
    measured_on: Sequence[DeviceRun] | None = None,
    own: Mapping[str, HiddenEffect] = MappingProxyType({}),
) -> Hidden:
    """Return the campaign with `name` hidden in it; without `sensor` the seed chooses one.

    The magnitude is that in `measured_on` where given: runs of the device before it aged. `own`
    are effects beside those the simulator has.
    """
    check_hideable(name, own)
    if name == NOTHING:
        return Hidden(list(runs), Truth(None, 'nothing', law=name))
    if name in HIDDEN_EFFECTS or name in own:
        effect = HIDDEN_EFFECTS[name] if name in HIDDEN_EFFECTS else own[name]
        return _hide_effect(runs, effect, magnitude, seed, sensor, measured_on)
    if name == CLOCK_TEMPERATURE:
        return _hide_clock(runs, magnitude, seed)
    if name in UNLOGGED_EFFECTS:
        effect = UNLOGGED_EFFECTS[name]
        hidden = _hide_effect(runs, effect, magnitude, seed, sensor, measured_on)
        return replace(hidden, finish=partial(_replaced, dict.fromkeys(effect.logged_as)))
    return _hide_fault(runs, name, magnitude, seed, sensor)


def random_name(seed: int) -> str:
    """Return what 'random' hides: mostly effects, sometimes nothing, a fault, a missing log."""
    generator = np.random.default_rng((seed, 29))
    kinds = (
        [name for name, effect in HIDDEN_EFFECTS.items() if effect.kind != 'unexplained'],
        [name for name, effect in HIDDEN_EFFECTS.items() if effect.kind == 'unexplained'],
        list(UNLOGGED_EFFECTS),
        list(DATA_FAULTS),
        [CLOCK_TEMPERATURE],
        [NOTHING],
    )
    kind = kinds[int(generator.choice(len(kinds), p=[0.68, 0.08, 0.06, 0.06, 0.02, 0.10]))]
    return str(generator.choice(kind))


def _chosen(sensors: Sequence[str], sensor: str | None, seed: int) -> str:
    if sensor is None:
        return str(np.random.default_rng((seed, 31)).choice(list(sensors)))
    if sensor not in sensors:
        raise UserError(f'--sensor {sensor}: this one hides in {", ".join(sensors)}')
    return sensor


def _hide_effect(
    runs: Sequence[DeviceRun],
    effect: HiddenEffect,
    magnitude: float,
    seed: int,
    sensor: str | None,
    measured_on: Sequence[DeviceRun] | None,
) -> Hidden:
    changed, truth = add_hidden_effect(
        runs,
        effect,
        sensor=_chosen(effect.sensors, sensor, seed),
        magnitude_wanted=magnitude,
        seed=seed,
        measured_on=measured_on,
    )
    return Hidden(changed, truth)


def _hide_clock(runs: Sequence[DeviceRun], magnitude: float, seed: int) -> Hidden:
    """Let the sensor's clock run faster or slower with temperature."""
    sign = float(np.random.default_rng((seed, 23)).choice([-1.0, 1.0]))
    slope = sign * CLOCK_SLOPE * magnitude
    truth = Truth(
        name=CLOCK_TEMPERATURE,
        kind='effect',
        sensor='all',
        magnitude=magnitude,
        law=CLOCK_TEMPERATURE,
        parameters={'relative_rate_per_kelvin': slope},
    )
    return Hidden([replace(run, rate_slope=slope) for run in runs], truth)


def as_recorded(
    truth: Truth,
    recordings: Sequence[ImuRecording],
    own: Mapping[str, HiddenEffect] = MappingProxyType({}),
) -> Truth:
    """Return the truth about recordings: an effect whose cause none of them logged is unlogged.

    The tracks are left out with another effect, too: a compressor with what it shakes. `own` are
    effects beside those the simulator has.
    """
    effect = HIDDEN_EFFECTS.get(truth.law, own.get(truth.law))
    if truth.kind != 'effect' or effect is None or not effect.logged_as:
        return truth
    cause = effect.logged_as[0]
    if any(getattr(recording, cause) is not None for recording in recordings):
        return truth
    depends_on = (cause.removesuffix('_voltage'), 'chamber')
    return replace(truth, name=None, kind='unlogged', depends_on=depends_on)


def _replaced(values: Mapping[str, Any], recordings: list[ImuRecording]) -> list[ImuRecording]:
    """Return the recordings with fields replaced."""
    return [replace(recording, **values) for recording in recordings]


def _hide_fault(
    runs: Sequence[DeviceRun], name: str, magnitude: float, seed: int, sensor: str | None
) -> Hidden:
    if name == 'startup_transient':
        chosen = 'all'
    elif name == 'orientation_flip':
        chosen = 'accelerometer'
    else:
        chosen = _chosen(tuple(SENSOR_FIELDS), sensor, seed)
    truth = Truth(name=name, kind='data_quality', sensor=chosen, magnitude=magnitude, law=name)
    if name == 'startup_transient':
        return Hidden(list(runs), truth, startup_time=60.0 + 30.0 * magnitude)
    if name == 'saturation':
        return Hidden(saturate(runs, chosen, magnitude), truth)
    return Hidden(list(runs), truth, finish=partial(_with_fault, truth, seed))


def _with_fault(truth: Truth, seed: int, recordings: list[ImuRecording]) -> list[ImuRecording]:
    """Return the recordings with a fault of the data."""
    generator = np.random.default_rng((seed, 37))
    return FAULTS[truth.law](recordings, str(truth.sensor), truth.magnitude, generator)
