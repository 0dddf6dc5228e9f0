# SPDX-License-Identifier: Apache-2.0
"""The situations of filters_stress.py: temperature, bad starts, shakes, magnets, gaps, six axes.

Written from the physics; nothing here knows of the filters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.bags.reader import read_bag
from imu_recording.recording import FloatArray
from scipy.spatial.transform import Rotation
from stress_motion import (
    GRAVITY,
    RATE_HZ,
    Motion,
    at_rest,
    direction,
    level,
    measure,
    move,
    small_bias,
    times,
)

from imu_recording import ImuRecording

BAGS = Path(__file__).resolve().parents[1] / 'bags'
ALL = slice(None)


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
