# SPDX-License-Identifier: Apache-2.0
"""Motion and what sensors say of it, from closed formulas: for filters_stress.py.

Attitudes and paths are sums of waves; noises, field and pace of the motion are the table's, or
from seed DRAWN on drawn from wide ranges.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from imu_recording.recording import FloatArray
from orientation_filters.rotation.arrays import conjugate, normalised, rotate
from scipy.spatial.transform import Rotation

from imu_recording import ImuRecording

RATE_HZ = 100.0
GRAVITY = 9.81
DRAWN = 1_000_000
"""Seeds from here on have surroundings of their own."""
SOFT_S = 0.5
"""Time a motion takes to start or stop [s]."""


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
