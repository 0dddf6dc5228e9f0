# SPDX-License-Identifier: Apache-2.0
"""Attitude under temperature, bad starts, gaps, magnets: python benchmarks/filters_stress.py.

Every situation is written from the physics (attitudes and paths as closed formulas, sensors with
noise, bias, jitter and losses) and knows nothing of the filters. Both filters, preset robust,
beside VQF in the same run: rms of the angle between estimate and truth over the rows that count,
mean over the seeds; of the covariance the normalised squared error per degree of freedom (1 where
it is true) and the share of rows within the 95 % bound. --seeds and --first-seed choose the seeds.
--drawn: every seed has a device, a place and a pace of its own (noises, field and frequencies of
the motion drawn from wide ranges), on which nothing was tuned; an error may then be as large as
VQF's where that is above the table's. Exit code 1 where a claim fails.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.bags.reader import read_bag
from imu_recording.recording import FloatArray
from orientation_filters.errors import attitude_errors, normalised_errors
from orientation_filters.filters import FILTERS, run_filter
from orientation_filters.rotation.arrays import (
    conjugate,
    heading_angle,
    multiply,
    normalised,
    rotate,
)
from scipy.spatial.transform import Rotation
from verdict import Verdict, judge
from vqf import VQF

from imu_recording import ImuRecording

RATE_HZ = 100.0
GRAVITY = 9.81
DRAWN = 1_000_000
"""Seeds from here on have surroundings of their own."""
BAGS = Path(__file__).resolve().parents[1] / 'bags'
NEES = (0.5, 2.0)
COVERAGE = (0.90, 0.99)
CHI2_95 = 7.815
"""95 % of chi-square with three degrees of freedom."""
SOFT_S = 0.5
"""Time a motion takes to start or stop [s]."""
ALL = slice(None)


@dataclass(frozen=True, eq=False)
class Motion:
    """Attitude, body rates and acceleration in the world at given times, all closed formulas."""

    orientation: FloatArray
    rate: FloatArray
    acceleration: FloatArray


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Device, place and pace of a run: a consumer chip at 100 Hz, 48 µT dipping 64°."""

    rate_noise: float = float(np.radians(0.07))
    """White, of a sample [rad/s]."""
    force_noise: float = 0.03
    """[m/s²]"""
    field_noise: float = 0.4e-6
    """[T]"""
    world_field: FloatArray = field(default_factory=lambda: 1e-6 * np.array([0.0, 21.0, -43.0]))
    """[T] ENU"""
    pace: float = 1.0
    """Frequencies of the motion over those of the table."""


def surroundings(seed: int) -> Surroundings:
    """Return what a seed is measured with and where: the table's, or drawn from wide ranges."""
    table = Surroundings()
    if seed < DRAWN:
        return table
    rng = np.random.default_rng([seed, 9])
    rate, force, magnetometer = 2.0 ** rng.uniform(-1.5, 1.5, 3)
    strength, dip = rng.uniform(25e-6, 65e-6), np.radians(rng.uniform(-70.0, 70.0))
    return Surroundings(
        rate_noise=rate * table.rate_noise,
        force_noise=force * table.force_noise,
        field_noise=magnetometer * table.field_noise,
        world_field=strength * np.array([0.0, np.cos(dip), -np.sin(dip)]),
        pace=rng.uniform(0.6, 1.5),
    )


@dataclass(frozen=True, eq=False)
class Run:
    """One recording, its true attitude, the rows that count and what else the filters know."""

    recording: ImuRecording
    truth: FloatArray
    rows: Any = ALL
    options: dict[str, Any] = field(default_factory=dict)
    peer: dict[str, Any] = field(default_factory=dict)
    """The same knowledge as VQF's parameters."""


@dataclass(frozen=True)
class Situation:
    """A row of the table: how a seed becomes a run, and the largest error wanted [deg]."""

    name: str
    make: Callable[[int], Run]
    limit: float
    worst: float = np.inf
    """Largest error of any seed [deg]."""


def waves(
    rng: np.random.Generator, amplitude: FloatArray, low_hz: float, high_hz: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return amplitudes, angular frequencies and phases (k, 4) of four waves per component."""
    shape = (len(amplitude), 4)
    share = rng.dirichlet(np.ones(4), size=len(amplitude))
    return (
        amplitude[:, None] * share,
        2.0 * np.pi * rng.uniform(low_hz, high_hz, shape),
        rng.uniform(0.0, 2.0 * np.pi, shape),
    )


def at(wave: tuple[FloatArray, FloatArray, FloatArray], s: FloatArray) -> tuple[FloatArray, ...]:
    """Return sums of waves and their first and second derivatives at s, (n, k) each."""
    a, w, phase = wave
    angle = w * s[:, None, None] + phase
    return (
        (a * np.sin(angle)).sum(axis=2),
        (a * w * np.cos(angle)).sum(axis=2),
        (-a * w * w * np.sin(angle)).sum(axis=2),
    )


def flow(
    time: FloatArray, pauses: tuple[float, float] | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return how far a motion has gone at each time, its speed 0 … 1 and the change of that.

    `pauses` [s]: moving time and resting time, in turn; starting and stopping take half a second.
    """
    if pauses is None:
        return time, np.ones_like(time), np.zeros_like(time)
    move, still = pauses
    turn, x = np.divmod(time, move + still)
    y = np.minimum(x, np.maximum(move - x, 0.0))
    begun = np.clip(y, 0.0, SOFT_S)
    angle = np.pi * begun / SOFT_S
    run_up = 0.5 * (begun - SOFT_S / np.pi * np.sin(angle)) + np.clip(y - SOFT_S, 0.0, None)
    gone = turn * (move - SOFT_S) + np.where(x < 0.5 * move, run_up, move - SOFT_S - run_up)
    side = np.where(x < 0.5 * move, 1.0, -1.0)
    change = side * 0.5 * np.pi / SOFT_S * np.sin(angle)
    return gone, 0.5 * (1.0 - np.cos(angle)), change


def move(
    seed: int,
    time: FloatArray,
    *,
    turn_deg: float = 30.0,
    turn_hz: tuple[float, float] = (0.1, 0.4),
    path_m: float = 0.0,
    path_hz: tuple[float, float] = (0.5, 1.5),
    pauses: tuple[float, float] | None = None,
) -> Motion:
    """Return a motion about and along all axes; `turn_deg` and `path_m` are amplitudes."""
    rng = np.random.default_rng(seed)
    gone, speed, change = flow(time, pauses)
    amplitude = np.radians(turn_deg) * np.array([2.0, 0.7, 1.0])
    gone, speed, change = (surroundings(seed).pace * x for x in (gone, speed, change))
    angles, slopes, _ = at(waves(rng, amplitude, *turn_hz), gone)
    yaw, pitch, roll = (angles + rng.uniform(-1.0, 1.0, 3) * [np.pi, 0.3, 1.0]).T
    d_yaw, d_pitch, d_roll = (slopes * speed[:, None]).T
    rate = np.column_stack(
        [
            d_roll - d_yaw * np.sin(pitch),
            d_pitch * np.cos(roll) + d_yaw * np.cos(pitch) * np.sin(roll),
            d_yaw * np.cos(pitch) * np.cos(roll) - d_pitch * np.sin(roll),
        ]
    )
    orientation = Rotation.from_euler('ZYX', np.column_stack([yaw, pitch, roll])).as_quat()
    _, velocity, curve = at(waves(rng, path_m * np.ones(3), *path_hz), gone)
    acceleration = curve * speed[:, None] ** 2 + velocity * change[:, None]
    return Motion(orientation, rate, acceleration)


def times(seconds: float) -> FloatArray:
    """Return sample times [s] of 100 Hz."""
    return np.arange(round(seconds * RATE_HZ)) / RATE_HZ


def at_rest(seed: int, time: FloatArray) -> Motion:
    """Return a resting device in a random attitude."""
    rng = np.random.default_rng(seed)
    q = normalised(rng.normal(size=4))
    return Motion(np.tile(q, (len(time), 1)), np.zeros((len(time), 3)), np.zeros((len(time), 3)))


def measure(
    seed: int,
    time: FloatArray,
    motion: Motion,
    *,
    bias: FloatArray | float = 0.0,
    field_error: FloatArray | float = 0.0,
    shake: FloatArray | float = 0.0,
) -> ImuRecording:
    """Return what the sensors say; bias [rad/s] sensor, field_error [T] and shake [m/s²] world."""
    rng, around = np.random.default_rng([seed, 1]), surroundings(seed)
    back = conjugate(motion.orientation)
    force = motion.acceleration + shake + np.array([0.0, 0.0, GRAVITY])
    n = len(time)
    return ImuRecording(
        stamp=1_000_000_000 + np.round(time * 1e9).astype(np.int64),
        angular_velocity=motion.rate + bias + around.rate_noise * rng.normal(size=(n, 3)),
        linear_acceleration=rotate(back, force) + around.force_noise * rng.normal(size=(n, 3)),
        magnetic_field=rotate(back, around.world_field + field_error)
        + around.field_noise * rng.normal(size=(n, 3)),
        temperature=np.full(n, 25.0),
    )


def direction(seed: int) -> FloatArray:
    """Return a random unit vector."""
    v = np.random.default_rng([seed, 2]).normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def level(seed: int) -> FloatArray:
    """Return a random horizontal unit vector."""
    angle = np.random.default_rng([seed, 3]).uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def small_bias(seed: int) -> FloatArray:
    """Return a constant bias as it is left after calibration, about 0.1 °/s."""
    return np.radians(0.1) * direction(seed)


def nominal(seed: int) -> Run:
    time = times(180.0)
    motion = move(seed, time, path_m=0.01, pauses=(20.0, 5.0))
    recording = measure(seed, time, motion, bias=small_bias(seed))
    return Run(recording, motion.orientation, time >= 30.0)


def rest_ramp(seed: int) -> Run:
    time = times(600.0)
    bias = np.radians(1.0) * (time / 600.0)[:, None] * direction(seed)
    motion = at_rest(seed, time)
    return Run(measure(seed, time, motion, bias=bias), motion.orientation)


def moving_ramp(seed: int) -> Run:
    time = times(600.0)
    bias = np.radians(1.0) * (time / 600.0)[:, None] * direction(seed)
    motion = move(seed, time, path_m=0.02, pauses=(40.0, 10.0))
    return Run(measure(seed, time, motion, bias=bias), motion.orientation)


def constant_bias(seed: int) -> Run:
    time = times(300.0)
    motion = move(seed, time, path_m=0.02, turn_deg=45.0)
    bias = np.radians(1.0) * direction(seed)
    return Run(measure(seed, time, motion, bias=bias), motion.orientation)


def shaken_start(seed: int) -> Run:
    time = times(10.0)
    motion = at_rest(seed, time)
    rng = np.random.default_rng([seed, 4])
    shake = np.where(time[:, None] < 0.25, 3.0 * rng.normal(size=3), 0.0)
    shake = shake * np.cos(2.0 * np.pi * rng.uniform(1.0, 4.0) * time)[:, None]
    recording = measure(seed, time, motion, bias=small_bias(seed), shake=shake)
    return Run(recording, motion.orientation, slice(-1, None))


def disturbed_start(seed: int) -> Run:
    time = times(180.0)
    motion = move(seed, time, turn_deg=60.0, path_m=0.01, pauses=(30.0, 3.0))
    error = np.where(time[:, None] < 5.0, 30e-6 * level(seed), 0.0)
    recording = measure(seed, time, motion, bias=small_bias(seed), field_error=error)
    return Run(recording, motion.orientation, time >= 90.0)


def moving_start(seed: int) -> Run:
    time = times(60.0)
    motion = move(seed, time)
    rng = np.random.default_rng([seed, 5])
    shake = 2.0 * level(seed) * np.sqrt(2.0)
    shake = shake * np.cos(2.0 * np.pi * rng.uniform(0.5, 1.5) * time)[:, None]
    recording = measure(seed, time, motion, bias=small_bias(seed), shake=shake)
    return Run(recording, motion.orientation, time >= 10.0)


def world_field(seed: int) -> Run:
    time = times(150.0)
    motion = move(seed, time, turn_deg=60.0, path_m=0.01)
    during = (time >= 60.0) & (time < 90.0)
    error = np.where(during[:, None], 40e-6 * level(seed), 0.0)
    recording = measure(seed, time, motion, bias=small_bias(seed), field_error=error)
    return Run(recording, motion.orientation, time >= 60.0)


def shake_at(hz: float) -> Callable[[int], Run]:
    def make(seed: int) -> Run:
        time = times(120.0)
        motion = move(seed, time, turn_deg=20.0)
        wave = np.sin(2.0 * np.pi * hz * time) * ((time > 20.0) & (time < 100.0))
        shake = GRAVITY * level(seed) * wave[:, None]
        recording = measure(seed, time, motion, bias=small_bias(seed), shake=shake)
        return Run(recording, motion.orientation, time >= 20.0)

    return make


def nan_bursts(seed: int) -> Run:
    time = times(180.0)
    motion = move(seed, time, turn_deg=45.0)
    recording = measure(seed, time, motion, bias=small_bias(seed))
    rng = np.random.default_rng([seed, 6])
    rate = recording.angular_velocity.copy()
    for start in np.flatnonzero(rng.uniform(size=len(time)) < 0.05 / 30.0):
        rate[start : start + 30] = np.nan
    return Run(replace(recording, angular_velocity=rate), motion.orientation)


def missing_stamps(seed: int) -> Run:
    time = times(180.0)
    motion = move(seed, time, turn_deg=45.0)
    recording = measure(seed, time, motion, bias=small_bias(seed))
    kept = np.flatnonzero(np.mod(time + 5.0, 10.0) >= 0.9)
    return Run(recording.rows(kept), motion.orientation[kept])


def jitter(seed: int) -> Run:
    rng = np.random.default_rng([seed, 7])
    time = np.sort(times(120.0) + rng.uniform(-0.009, 0.009, round(120.0 * RATE_HZ)))
    time = np.unique(time - time[0])
    motion = move(seed, time, turn_deg=60.0, turn_hz=(0.2, 0.5))
    recording = measure(seed, time, motion, bias=small_bias(seed))
    return Run(recording, motion.orientation, time >= 10.0)


def six_axis_turn(deg_per_s: float, *, known: bool) -> Callable[[int], Run]:
    def make(seed: int) -> Run:
        time = times(140.0)
        began = np.clip(time - 20.0, 0.0, None)
        heading = np.random.default_rng([seed, 8]).uniform(-np.pi, np.pi)
        yaw = heading + np.radians(deg_per_s) * began
        tilt = Rotation.from_rotvec(0.2 * level(seed))
        orientation = (Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0]) * tilt).as_quat()
        axis = tilt.inv().apply([0.0, 0.0, 1.0])
        rate = np.radians(deg_per_s) * (began > 0.0)[:, None] * axis
        motion = Motion(orientation, rate, np.zeros_like(rate))
        bias = np.radians(0.01 if known else 0.3) * direction(seed)
        recording = measure(seed, time, motion, bias=bias)
        recording = replace(recording, magnetic_field=np.full_like(rate, np.nan))
        options: dict[str, Any] = {'use_magnetometer': False}
        if not known:
            return Run(recording, orientation, options=options)
        sure = {'initial_bias': np.radians(0.01), 'bias_random_walk': np.radians(1e-4)}
        return Run(recording, orientation, options=options | sure, peer={'biasSigmaInit': 0.01})

    return make


def lost_magnetometer(seed: int) -> Run:
    """Rest for a minute, then the magnetometer is lost and the device turns steadily."""
    time = times(180.0)
    yaw = np.radians(8.0) * np.clip(time - 60.0, 0.0, None)
    orientation = Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0]).as_quat()
    rate = np.radians(8.0) * (time > 60.0)[:, None] * [0.0, 0.0, 1.0]
    motion = Motion(orientation, rate, np.zeros_like(rate))
    recording = measure(seed, time, motion, bias=small_bias(seed))
    lost = recording.magnetic_field.copy()
    lost[time >= 60.0] = np.nan
    return Run(replace(recording, magnetic_field=lost), orientation)


def real_ramp(seed: int) -> Run:
    """A resting device whose gyroscope errs as a simulated board of bags/ did on a ramp, raw."""
    axis = 'xyz'[seed % 3]
    bag = read_bag(BAGS / f'dut{1 + seed // 3 % 3}_{axis}')
    begin = int(np.searchsorted(bag.time, 3600.0 * (2.0 + seed % 5)))
    part = bag.rows(slice(begin, begin + 600))
    smooth = np.polynomial.Polynomial.fit
    time = times(600.0)
    known = part.time / (part.time[-1] / 600.0)
    bias = np.column_stack([smooth(known, w, 5)(time) for w in part.angular_velocity.T])
    motion = at_rest(seed, time)
    return Run(measure(seed, time, motion, bias=bias), motion.orientation)


SITUATIONS = (
    Situation('nominal', nominal, 0.1),
    Situation('rest, bias ramps 1 °/s in 10 min', rest_ramp, 0.3),
    Situation('rest, ramp of a bundled bag', real_ramp, 0.3),
    Situation('the same ramp in motion with pauses', moving_ramp, 0.7),
    Situation('bias 1 °/s, never at rest', constant_bias, 1.2),
    Situation('first 0.25 s shaken, at 10 s', shaken_start, 0.3, 1.0),
    Situation('starts in a disturbed field', disturbed_start, 1.1),
    Situation('starts in motion, 2 m/s²', moving_start, 0.5),
    Situation('world field + 40 µT for 30 s', world_field, 5.0),
    Situation('shaken by 1 g at 4 Hz', shake_at(4.0), 0.1),
    Situation('shaken by 1 g at 0.2 Hz', shake_at(0.2), 1.0),
    Situation('gyroscope NaN in bursts, 5 %', nan_bursts, 6.0),
    Situation('stamps missing for 0.9 s', missing_stamps, 9.0),
    Situation('jitter ± 9 ms in fast motion', jitter, 0.3),
    *(
        Situation(f'six axes, {rate:g} °/s, bias known', six_axis_turn(rate, known=True), 2.0)
        for rate in (1.0, 8.0, 11.0)
    ),
    *(
        Situation(f'six axes, {rate:g} °/s, bias unknown', six_axis_turn(rate, known=False), 180.0)
        for rate in (1.0, 8.0, 11.0)
    ),
    Situation('magnetometer lost, 8 °/s', lost_magnetometer, 2.0),
)


def run_vqf(run: Run) -> FloatArray:
    """Return VQF's attitude; a rate of NaN is held, as VQF has no way to say that it is absent."""
    r = run.recording
    rate = r.angular_velocity.copy()
    good = np.isfinite(rate).all(axis=1)
    newest = np.maximum.accumulate(np.where(good, np.arange(len(rate)), 0))
    vqf = VQF(1.0 / RATE_HZ, **run.peer)
    if np.isnan(r.magnetic_field).all():
        out = vqf.updateBatch(rate[newest], r.linear_acceleration)['quat6D']
    else:
        field = r.magnetic_field.copy()
        known = np.isfinite(field).all(axis=1)
        held = np.maximum.accumulate(np.where(known, np.arange(len(field)), 0))
        out = vqf.updateBatch(rate[newest], r.linear_acceleration, 1e6 * field[held])['quat9D']
    q: FloatArray = out[:, [1, 2, 3, 0]]
    return q


def aligned(q: FloatArray, truth: FloatArray) -> tuple[FloatArray, float]:
    """Return attitudes turned about the vertical to a true first heading, and the angle [rad]."""
    apart = multiply(truth[0], conjugate(q[0]))
    turn = normalised(apart * [0.0, 0.0, 1.0, 1.0])
    return multiply(turn, q), float(heading_angle(turn))


def judge_run(run: Run, label: str) -> list[float]:
    """Return rms error [deg], normalised squared error per degree and share within 95 %.

    With six axes the heading at the start is arbitrary: it is no part of the rms, but the
    covariance has to cover it.
    """
    covariance, turned = None, 0.0
    if label == 'vqf':
        q = run_vqf(run)
    else:
        result = run_filter(label, run.recording, preset='robust', **run.options)
        q, covariance = result.orientation, result.covariance
    six_axes = not run.options.get('use_magnetometer', True)
    if six_axes:
        q, turned = aligned(q, run.truth)
    rms = np.degrees(attitude_errors(q, run.truth).rms(_mask(run))['total'])
    if covariance is None:
        return [float(rms), np.nan, np.nan]
    squares = normalised_errors(q, run.truth, covariance) + turned**2 / covariance[:, 2, 2]
    squares = squares[run.rows]
    squares = squares[np.isfinite(squares)]
    return [float(rms), float(np.mean(squares)) / 3.0, float(np.mean(squares < CHI2_95))]


def _mask(run: Run) -> FloatArray:
    mask = np.zeros(len(run.truth), dtype=bool)
    mask[run.rows] = True
    return mask


def table(situations: tuple[Situation, ...], seeds: range) -> dict[str, dict[str, FloatArray]]:
    """Return (seeds, 3) figures by situation and filter."""
    found = {}
    for situation in situations:
        runs = [situation.make(seed) for seed in seeds]
        found[situation.name] = {
            label: np.array([judge_run(run, label) for run in runs]) for label in (*FILTERS, 'vqf')
        }
        report(situation, found[situation.name])
    return found


def report(situation: Situation, figures: dict[str, FloatArray]) -> None:
    """Print one row of the table."""
    cells = f'{situation.name:40}'
    for label, rows in figures.items():
        rms, nees, coverage = rows.mean(axis=0)
        cells += f'  {label[:4]} {rms:7.2f}° (worst {rows[:, 0].max():6.2f})'
        if label != 'vqf':
            cells += f' NEES {nees:6.2f} in {100 * coverage:4.0f} %'
    print(cells, flush=True)


def claims(
    situations: tuple[Situation, ...], found: dict[str, dict[str, FloatArray]], *, drawn: bool
) -> list[Verdict]:
    """Return the claims about every situation and filter."""
    verdicts = []
    for situation in situations:
        peer = float(found[situation.name]['vqf'][:, 0].mean()) if drawn else 0.0
        limit = max(situation.limit, peer)
        for label in FILTERS:
            rows = found[situation.name][label]
            claim = f'{label}, {situation.name}'
            rms, nees, coverage = rows.mean(axis=0)
            verdicts.append(Verdict(f'{claim}: rms', rms, limit, '°'))
            if np.isfinite(situation.worst) and not drawn:
                worst = rows[:, 0].max()
                verdicts.append(Verdict(f'{claim}: worst', worst, situation.worst, '°'))
            verdicts += [
                Verdict(f'{claim}: NEES', nees, NEES[1]),
                Verdict(f'{claim}: NEES', nees, NEES[0], at_least=True),
                Verdict(f'{claim}: within 95 %', coverage, COVERAGE[0], at_least=True),
                Verdict(f'{claim}: within 95 %', coverage, COVERAGE[1]),
            ]
    return verdicts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--first-seed', type=int, default=0)
    parser.add_argument('--drawn', action='store_true', help='devices and places by seed')
    parser.add_argument('--only', default='', help='part of the situation names to run')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    first = options.first_seed + (DRAWN if options.drawn else 0)
    seeds = range(first, first + options.seeds)
    situations = tuple(s for s in SITUATIONS if options.only in s.name)
    found = table(situations, seeds)
    failed = judge(claims(situations, found, drawn=options.drawn))
    if options.json:
        rows = {
            name: {label: figures.tolist() for label, figures in by_filter.items()}
            for name, by_filter in found.items()
        }
        content = {'seeds': list(seeds), 'rows': rows, 'failed': failed}
        options.json.write_text(json.dumps(content, indent=1) + '\n')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
