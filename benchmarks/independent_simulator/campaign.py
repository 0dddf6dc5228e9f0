# SPDX-License-Identifier: Apache-2.0
"""One campaign with hidden effects, and the truth about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.bags.writer import write_bag
from imu_recording.recording import ImuRecording

from independent_simulator.device import (
    LEAST_COUNTS,
    OFFSETS,
    SENSORS,
    Device,
    Logger,
    Rows,
    draw_device,
    draw_rows,
    fast_noise,
    followed,
    quantised,
    reading,
    reference_thermometer,
    shaking,
    slow_noise,
)
from independent_simulator.laws import CATALOGUE, OUTSIDE, REFERENCE, Law, Parameters
from independent_simulator.projection import Projection
from independent_simulator.scenarios import SCENARIOS, Plan
from independent_simulator.surroundings import Array, Conditions, draw_house, surroundings

FIELDS = dict(
    zip(SENSORS, ('linear_acceleration', 'angular_velocity', 'magnetic_field'), strict=True)
)
SEALED = 900_000
"""Seeds from here on are for the last judgement only: nothing is tuned on them."""
EARTH_RATE = np.array([0.0, 5.3e-5, 4.9e-5])
"""In the chamber frame, at 43° north [rad/s]."""
EPOCH_NS = 1_750_000_000_000_000_000
COUNTS = {0: 0.2, 1: 0.42, 2: 0.2, 3: 0.06, -1: 0.12}
"""Share of campaigns with so many effects; −1: one law outside the catalogue."""
MAGNITUDES = (0.3, 60.0)
MOST_UNEQUAL = 15.0
LEAST_VISIBLE = 0.03
"""A law of whose signal less remains beside a level and a line in the temperature is not drawn."""
RIVAL_ROWS = 1200
RIVAL_DRAWS = 4


@dataclass(frozen=True)
class HiddenLaw:
    name: str
    sensors: tuple[str, ...]
    magnitude: float
    """Root mean square on the most affected channel, beside a level per run and a line in the
    recorded temperature, in standard deviations of a one-second mean."""
    parameters: Parameters
    amplitude: Mapping[str, list[float]]
    """Per sensor: coefficient of each axis [SI unit per unit of the law's signal]."""
    in_catalogue: bool
    needs: tuple[str, ...]
    logged: bool
    """One of the tracks it needs was logged, or it needs none."""
    visible: float
    """Share of the signal that a level and a line do not take."""
    rival: str
    """The law of the catalogue that comes nearest."""
    rival_share: float
    """Share of the signal's energy that the rival explains, beside level and line."""


@dataclass(frozen=True)
class Truth:
    seed: int
    scenario: str
    effects: tuple[HiddenLaw, ...]
    overlap: float
    """Largest |cosine| between two of the effects on the same sensor."""
    noise: str
    thermometer: str
    thermometer_magnitude: Mapping[str, float]
    """Per sensor: what the thermometer's lag, hysteresis and warm-up leave of the line in the true
    temperature, as a magnitude. From about 0.3 on it shows as a lag of that sensor."""
    one_second: Mapping[str, float]
    """Per sensor: standard deviation of a one-second mean [SI]."""
    tracks: tuple[str, ...]
    duration_s: float
    error: tuple[Mapping[str, Array], ...] = field(repr=False)
    """Per run and sensor: (n, 3) measured − true, without noise."""
    hidden: tuple[tuple[Mapping[str, Array], ...], ...] = field(repr=False)
    """Per effect, run and sensor: (n, 3) its part of the error."""

    @property
    def unlogged(self) -> bool:
        """Whether an effect acts whose track was not logged."""
        return any(not effect.logged for effect in self.effects)

    def to_dict(self) -> dict[str, Any]:
        """Return all but the arrays, for a line of JSON."""
        content = {
            key: value
            for key, value in vars(self).items()
            if key not in ('error', 'hidden', 'effects')
        }
        content['effects'] = [asdict(effect) for effect in self.effects]
        content['unlogged'] = self.unlogged
        return content


@dataclass(frozen=True)
class Campaign:
    recordings: tuple[ImuRecording, ...]
    truth: Truth

    def write(self, folder: Path) -> None:
        """Write one bag per run."""
        for recording in self.recordings:
            write_bag(recording, folder / recording.run)


def draw_campaign(
    seed: int,
    scenario: str = '',
    hide: Sequence[tuple[str, float]] | None = None,
    rivals: bool = True,
) -> Campaign:
    """Return the campaign of a seed; the scenario and what is hidden are drawn, or given.

    `hide` holds names with a magnitude each. The same seed has the same device, surroundings and
    noise whatever is hidden. A law that the recording cannot show raises ValueError.
    """
    keys = np.random.SeedSequence(seed).spawn(7)
    choice, world, device_key, logging, laws, placing, noise = map(np.random.default_rng, keys)
    scenario = scenario or str(choice.choice(list(SCENARIOS)))
    plan = SCENARIOS[scenario](choice)
    house = draw_house(world, plan.programmes[0].kind)
    runs = [surroundings(programme, house, world) for programme in plan.programmes]
    kind = str(choice.choice(['lsm9ds1', 'quiet', 'loud'], p=[0.6, 0.2, 0.2]))
    quality = str(choice.choice(['good', 'fair', 'poor'], p=[0.5, 0.35, 0.15]))
    device = draw_device(device_key, kind, quality)
    tracks = _tracks(plan, logging)
    warmth = [followed(device.thermometer, run) for run in runs]
    rows = [
        draw_rows(logger, run, device, placing)
        for logger, run in zip(plan.loggers, runs, strict=True)
    ]
    temperatures = [
        _temperature(row, reading(device.thermometer, one, row.dt, device_key))
        for row, one in zip(rows, warmth, strict=True)
    ]
    true = [row.of(run.die) for row, run in zip(rows, runs, strict=True)]
    smooth = [row.of(one) for row, one in zip(rows, warmth, strict=True)]
    basis = Projection(rows, temperatures)
    shown = _Shown(runs, rows, basis, Projection(rows, true), device)
    drawn = _draw_laws(laws, shown, hide)
    logged = (*tracks, 'vibration') if plan.loggers[0].period <= 0.02 else tracks
    effects = [_hidden_law(one, logged, runs, laws if rivals else None) for one in drawn]
    errors = _errors(device, runs, rows, drawn, device_key)
    recordings = [
        replace(
            _recording(plan, number, run, rows[number], temperatures[number]),
            **_measured(plan, number, device, run, rows[number], errors[number], noise),
            **_logged(run, rows[number], tracks, plan.loggers[number], noise),
        )
        for number, run in enumerate(runs)
    ]
    truth = Truth(
        seed, scenario, tuple(effects), _overlap(drawn, basis), kind, quality,
        _thermometer_magnitudes(device, Projection(rows, smooth)(true)),
        {sensor: device.noise[sensor].one_second for sensor in SENSORS}, tracks,
        float(sum(row.time[-1] - row.time[0] for row in rows)),
        tuple(errors), tuple(one.signals for one in drawn),
    )  # fmt: skip
    return Campaign(tuple(recordings), truth)


@dataclass(frozen=True)
class _Drawn:
    name: str
    law: Law
    sensors: tuple[str, ...]
    magnitude: float
    parameters: Parameters
    coefficients: Mapping[str, Array]
    signals: tuple[Mapping[str, Array], ...]
    """Per run and sensor (n, 3), at the rows."""
    visible: float


@dataclass(frozen=True)
class _Shown:
    """What a law can be seen through."""

    runs: Sequence[Conditions]
    rows: Sequence[Rows]
    basis: Projection
    exact: Projection
    """With the true temperature of the die in place of the recorded one."""
    device: Device


def _draw_laws(
    rng: np.random.Generator, shown: _Shown, hide: Sequence[tuple[str, float]] | None
) -> list[_Drawn]:
    if hide is not None:
        found = [_draw_law(name, magnitude, rng, shown) for name, magnitude in hide]
        if None in found:
            name = hide[found.index(None)][0]
            raise ValueError(f'{name}: this recording cannot show it; take another scenario')
        return [one for one in found if one is not None]
    count = int(rng.choice(list(COUNTS), p=list(COUNTS.values())))
    names = list(OUTSIDE if count < 0 else CATALOGUE)
    strongest = float(np.exp(rng.uniform(*np.log(MAGNITUDES))))
    drawn: list[_Drawn] = []
    for name in rng.permutation(names):
        if len(drawn) == abs(count):
            break
        unequal = np.exp(rng.uniform(0.0, np.log(MOST_UNEQUAL))) if drawn else 1.0
        magnitude = max(MAGNITUDES[0], strongest / unequal)
        one = _draw_law(str(name), magnitude, rng, shown)
        if one is not None:
            drawn.append(one)
    return drawn


def _draw_law(
    name: str,
    magnitude: float,
    rng: np.random.Generator,
    shown: _Shown,
) -> _Drawn | None:
    """Return the law with the wanted magnitude; None where the recording does not show it."""
    law = {**CATALOGUE, **OUTSIDE}[name]
    sensors = law.sensors if law.joint else (str(rng.choice(law.sensors)),)
    if not law.joint and name in ('bias_step', 'bias_creep', 'warm_up') and rng.random() < 0.3:
        sensors = tuple(rng.choice(law.sensors, 2, replace=False).tolist())
    parameters = law.draw(rng, shown.runs)
    signals = [
        {sensor: _three(row.of(law.signal(run, sensor, parameters))) for sensor in sensors}
        for run, row in zip(shown.runs, shown.rows, strict=True)
    ]
    coefficients = {
        sensor: np.ones(3)
        if law.coupled
        else shown.device.noise[sensor].one_second
        * rng.uniform(0.15, 1.0, 3)
        * rng.choice([-1, 1], 3)
        for sensor in sensors
    }
    strength, visible = 0.0, 0.0
    for sensor in sensors:
        of_runs = [one[sensor] * coefficients[sensor] for one in signals]
        size = np.sqrt((shown.basis(of_runs) ** 2).mean(0))
        size /= shown.device.noise[sensor].one_second
        if size.max() > strength:
            strength, visible = float(size.max()), shown.exact.visible(of_runs)
    if visible < LEAST_VISIBLE or not np.isfinite(strength) or strength <= 0.0:
        return None
    scaled = {s: c * magnitude / strength for s, c in coefficients.items()}
    parts = tuple({s: one[s] * scaled[s] for s in sensors} for one in signals)
    return _Drawn(name, law, sensors, magnitude, parameters, scaled, parts, visible)


def _three(signal: Array) -> Array:
    return np.repeat(signal[:, None], 3, axis=1) if signal.ndim == 1 else signal


def _hidden_law(
    one: _Drawn,
    logged: Sequence[str],
    runs: Sequence[Conditions],
    rng: np.random.Generator | None,
) -> HiddenLaw:
    rival, share = _rival(one, runs, rng) if rng is not None else ('', float('nan'))
    needs = ('heater',) if one.parameters.get('gated') else one.law.needs
    return HiddenLaw(
        one.name, one.sensors, one.magnitude, one.parameters,
        {sensor: value.tolist() for sensor, value in one.coefficients.items()},
        one.name in CATALOGUE, needs, not needs or any(track in logged for track in needs),
        one.visible, rival, share,
    )  # fmt: skip


def _rival(one: _Drawn, runs: Sequence[Conditions], rng: np.random.Generator) -> tuple[str, float]:
    """Return the other law of the catalogue that explains most of this one, and the share.

    Computed on a coarse grid, with a few draws of the rival's shape and free coefficients on every
    axis: a rough figure of what the recording separates.
    """
    step = max(1, sum(len(run.time) for run in runs) // RIVAL_ROWS)
    coarse = [run.every(step) for run in runs]
    lengths = [len(run.time) for run in coarse]
    ones = [Rows(run.time - run.time[0], run.dt, 1, np.arange(n), run.dt, 1.0, 1.0)
            for run, n in zip(coarse, lengths, strict=True)]  # fmt: skip
    basis = Projection(ones, [run.die for run in coarse])

    def columns(law: Law, sensor: str, parameters: Parameters) -> Array:
        return basis([_three(law.signal(run, sensor, parameters)) for run in coarse])

    own = {s: columns(one.law, s, one.parameters) * one.coefficients[s] for s in one.sensors}
    energy = sum(float((y**2).sum()) for y in own.values())
    best, name = 0.0, ''
    for other, law in CATALOGUE.items():
        if other == one.name or not set(one.sensors) <= set(law.sensors):
            continue
        for _ in range(RIVAL_DRAWS if law.draw(rng, coarse) else 1):
            parameters = law.draw(rng, coarse)
            taken = 0.0
            for sensor, y in own.items():
                c = columns(law, sensor, parameters)
                square = (c**2).sum(0)
                seen = square > 1e-12 * square.max(initial=1e-12)
                taken += float((((c * y).sum(0)) ** 2)[seen] @ (1.0 / square[seen]))
            if taken > best:
                best, name = taken, other
    return name, best / max(energy, 1e-300)


def _overlap(drawn: Sequence[_Drawn], basis: Projection) -> float:
    most = 0.0
    for i, a in enumerate(drawn):
        for b in drawn[:i]:
            for sensor in set(a.sensors) & set(b.sensors):
                x, y = (basis([run[sensor] for run in one.signals]).ravel() for one in (a, b))
                both = float(np.linalg.norm(x) * np.linalg.norm(y))
                most = max(most, abs(float(x @ y)) / both if both else 0.0)
    return most


def _errors(
    device: Device,
    runs: Sequence[Conditions],
    rows: Sequence[Rows],
    drawn: Sequence[_Drawn],
    rng: np.random.Generator,
) -> list[dict[str, Array]]:
    """Return measured − true without noise: offsets, the line in the temperature, the hidden."""
    errors: list[dict[str, Array]] = []
    for number, (run, row) in enumerate(zip(runs, rows, strict=True)):
        x = row.of(run.die) - REFERENCE
        errors.append({})
        for sensor in SENSORS:
            level = device.offsets[sensor] + rng.normal(0.0, OFFSETS[sensor][1], 3)
            total = level + np.outer(x, device.slopes[sensor])
            for one in drawn:
                if sensor in one.sensors:
                    total = total + one.signals[number][sensor]
            errors[-1][sensor] = total
    return errors


def _thermometer_magnitudes(device: Device, left: Array) -> dict[str, float]:
    """Return what remains of the line in the true temperature beside one in the thermometer's."""
    size = float(np.sqrt((left**2).mean()))
    return {
        sensor: size * float(np.abs(device.slopes[sensor]).max()) / device.noise[sensor].one_second
        for sensor in SENSORS
    }


def _temperature(rows: Rows, read: Array) -> Array:
    return rows.of(read) if rows.means > 1 else rows.held(read)


def _tracks(plan: Plan, rng: np.random.Generator) -> tuple[str, ...]:
    return tuple(track for track, share in plan.tracks.items() if rng.random() < share)


def _recording(
    plan: Plan, number: int, run: Conditions, rows: Rows, temperature: Array
) -> ImuRecording:
    """Return a recording in which nothing has been measured yet but the temperature."""
    pose = plan.programmes[number].up_axis
    nothing = np.full((len(rows.time), 3), np.nan)
    return ImuRecording(
        stamp=EPOCH_NS + np.round((run.time[0] + rows.time) * 1e9).astype(np.int64),
        angular_velocity=nothing,
        linear_acceleration=nothing,
        magnetic_field=nothing,
        temperature=temperature,
        device='sim1',
        run=f'run{number + 1}_{pose.replace("+", "p").replace("-", "m")}',
        up_axis=pose,
        profile=plan.programmes[number].kind,
    )


def _measured(
    plan: Plan,
    number: int,
    device: Device,
    run: Conditions,
    rows: Rows,
    error: Mapping[str, Array],
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return what the three sensors say."""
    period = plan.loggers[number].period
    true = {
        'accelerometer': run.force,
        'gyroscope': run.rotation @ EARTH_RATE,
        'magnetometer': run.rotation @ run.field,
    }
    measured = {}
    for sensor in SENSORS:
        noise = device.noise[sensor]
        slow = rows.of(slow_noise(noise, len(run.time), run.dt, rng))
        signal = true[sensor] + error[sensor] + slow + fast_noise(noise, rows, rng)
        if sensor == 'accelerometer':
            signal = signal + shaking(run, rows, period, rng)
        scales = LEAST_COUNTS[sensor]
        finest = int(rng.integers(len(scales))) if plan.ranges else 0
        measured[FIELDS[sensor]] = quantised(
            signal, device.least_count * scales[finest], rows.samples
        )
    every = plan.loggers[number].magnetometer_every
    measured['magnetic_field'][np.arange(len(rows.time)) % every != 0] = np.nan
    return measured


def _logged(
    run: Conditions, rows: Rows, tracks: Sequence[str], logger: Logger, rng: np.random.Generator
) -> dict[str, Array]:
    """Return the optional tracks."""

    def newest(signal: Array) -> Array:
        return rows.of(signal) if rows.means else rows.held(signal)

    def steps(signal: Array, step: float, noise: float) -> Array:
        return np.round((signal + rng.normal(0.0, noise, len(signal))) / step) * step

    read = {
        'chamber_temperature': lambda: newest(reference_thermometer(run.air, run.dt, rng)),
        'chamber_temperature_2': lambda: newest(reference_thermometer(run.air, run.dt, rng)),
        'device_temperature': lambda: newest(reference_thermometer(run.board, run.dt, rng)),
        'setpoint': lambda: rows.held(run.setpoint),
        'humidity': lambda: newest(np.clip(steps(run.humidity, 0.001, 0.003), 0.0, 1.0)),
        'heater': lambda: newest(run.heater),
        'compressor': lambda: newest(run.compressor),
        'fan': lambda: newest(run.fan),
        'supply_voltage': lambda: newest(steps(run.supply, 0.001, 0.001)),
        'phase': lambda: rows.held(run.phase),
    }
    logged = {track: read[track]() for track in tracks if track in read}
    if 'phase' in logged and logged['phase'].max() < 0:
        del logged['phase']
    if 'phase' in logged:
        logged['cycle'] = rows.held(run.cycle)
    if 'vibration' in tracks and logger.period > 0.02:
        freedom = int(rng.integers(20, 200))
        scatter = rng.chisquare(freedom, (len(rows.time), 3)) / freedom
        logged['vibration'] = np.maximum(rows.of(run.vibration), 0.0) * scatter
    return logged
