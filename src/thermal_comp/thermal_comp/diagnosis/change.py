# SPDX-License-Identifier: Apache-2.0
"""What changed in a device since its model was fitted: stored coefficients against these runs.

With c₀ the stored coefficients of an effect, c those fitted to these runs and S the sum of their
covariances, the effect is r times as large, r = c₀ᵀS⁻¹c / c₀ᵀS⁻¹c₀ ± (c₀ᵀS⁻¹c₀)^−½, and it
changed by (c − c₀)ᵀS⁻¹(c − c₀), which is χ² where nothing did (Wald's test).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray
from scipy.special import chdtri

from thermal_comp.comparison.compare import Comparison
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.result import Finding
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.normal_equations import pseudo_solve
from thermal_comp.model.values import SensorModel, ThermalModel

LARGEST_CHANCE = 1e-6
"""Probability with which chance alone changes the coefficients of one effect so much."""
LEAST_CHANGE_FLOORS = 0.25
"""Change of the modelled error, in noise floors of a block, below which nothing is said."""
LEAST_APART_S = 7 * 86400.0
"""Time without a recording from which runs are campaigns of their own [s]."""


def later_campaign(runs: Sequence[PreparedRun]) -> str:
    """Return how to tell whether a device has changed between two campaigns; '' for one alone.

    Fitted together, runs of a device that has aged depend on time in a way no effect describes.
    """
    ordered = sorted(runs, key=lambda run: run.origin)
    ends = [run.origin * 1e-9 + float(run.time[-1]) for run in ordered[:-1]]
    waits = [run.origin * 1e-9 - end for run, end in zip(ordered[1:], ends, strict=True)]
    if not waits or max(waits) < LEAST_APART_S:
        return ''
    first = ordered[int(np.argmax(waits)) + 1].name
    return (
        f'{first} begins {max(waits) / 86400.0:.0f} days after the runs before it: fit those; '
        f'diagnose {first} … --model MODEL says what has changed since'
    )


def changes(
    stored: ThermalModel,
    fitted: ThermalModel,
    runs: Sequence[PreparedRun],
    current: Comparison,
) -> list[Finding]:
    """Return the effects whose coefficients or shape are others in `fitted` than in `stored`.

    `fitted` has the effects of `stored`, refined to these runs.
    """
    found = []
    for sensor, compared in current.sensors.items():
        before, now = stored.sensors.get(sensor), fitted.sensors.get(sensor)
        if before is None or now is None or len(before.effects) != len(now.effects):
            continue
        floor = np.asarray(compared.noise_floor)
        for index, effect in enumerate(before.effects):
            if not effect.per_run and effect.coefficient_deviations() is None:
                found += list(_changed(sensor, effect, index, before, now, runs, floor))
    return found


def _changed(
    sensor: Sensor,
    effect: Effect,
    index: int,
    before: SensorModel,
    now: SensorModel,
    runs: Sequence[PreparedRun],
    floor: FloatArray,
) -> Iterator[Finding]:
    """Yield the finding about one effect, where its change is neither chance nor too small."""
    old, new = before.coefficients[index], now.coefficients[index]
    if old.shape != new.shape:
        return
    after = now.effects[index]
    moved = _moved_shapes(effect, after, before, now)
    spread = _block(before, index) + _block(now, index)
    weight, _ = pseudo_solve(spread, np.eye(len(spread)))
    difference = (new - old).ravel()
    wald = float(difference @ weight @ difference)
    share = _share(sensor, effect, after, old, new, runs, floor)
    evident = wald > float(chdtri(difference.size, LARGEST_CHANCE)) or moved
    if not evident or share < LEAST_CHANGE_FLOORS:
        return
    power = float(old.ravel() @ weight @ old.ravel())
    ratio = float(old.ravel() @ weight @ new.ravel()) / max(power, 1e-300)
    parameters: dict[str, Mapping[str, object]] = {
        'ratio': {'value': ratio, 'std': power**-0.5 if power > 0.0 else None, 'unit': '1'}
    }
    parameters |= moved
    yield Finding(
        kind='changed',
        name=effect.name,
        sensor=sensor,
        evidence=wald,
        threshold=float(chdtri(difference.size, LARGEST_CHANCE)),
        unit=SENSOR_UNITS[sensor],
        parameters=parameters,
        text=f'{sensor}: {effect.name} changed since the model was fitted, × {ratio:.3g}',
    )


def _moved_shapes(
    effect: Effect, after: Effect, before: SensorModel, now: SensorModel
) -> dict[str, Mapping[str, object]]:
    """Return the shape parameters that moved by more than chance, with what they are now."""
    moved: dict[str, Mapping[str, object]] = {}
    for name, value in effect.shape_parameters.items():
        key = f'{effect.name}.{name}'
        spreads = [model.shape_std.get(key) for model in (before, now)]
        if any(s is None for s in spreads):
            continue
        old, new = np.atleast_1d(value), np.atleast_1d(getattr(after, name))
        variance = sum(np.square(np.atleast_1d(np.asarray(s))) for s in spreads if s is not None)
        if old.shape != new.shape or not np.all(np.asarray(variance) > 0.0):
            continue
        if float(np.sum((new - old) ** 2 / variance)) > float(chdtri(old.size, LARGEST_CHANCE)):
            unit = type(effect).__dataclass_fields__[name].metadata['unit']
            std = now.shape_std[key]
            moved[name] = {
                'value': new.tolist() if new.size > 1 else float(new[0]),
                'std': list(std) if new.size > 1 else float(std[0]),
                'unit': unit,
            }
    return moved


def _block(model: SensorModel, index: int) -> FloatArray:
    """Return the covariance of one effect's coefficients."""
    start = sum(c.size for c in model.coefficients[:index])
    stop = start + model.coefficients[index].size
    return model.covariance[start:stop, start:stop]


def _share(
    sensor: Sensor,
    effect: Effect,
    after: Effect,
    old: FloatArray,
    new: FloatArray,
    runs: Sequence[PreparedRun],
    floor: FloatArray,
) -> float:
    """Return the rms of the change about the mean of each run, in floors, of the worst axis."""
    squares, rows = np.zeros(3), 0
    for run in runs:
        change = run.columns(after, sensor) @ new - run.columns(effect, sensor) @ old
        change = change - change.mean(axis=0)
        squares += (change**2).sum(axis=0)
        rows += len(change)
    return float((np.sqrt(squares / max(rows, 1)) / np.maximum(floor, 1e-300)).max())
