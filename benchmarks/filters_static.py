# SPDX-License-Identifier: Apache-2.0
"""What the filters find at rest: attitude, bias, jam, heading beside a magnet; run by filters.py.

Noise is what ahrsfilter's documented variances say, at 100 Hz, in a field of 50 µT that dips 50°.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray
from orientation_filters.ahrs.filter import initial_state, update
from orientation_filters.filters import FILTERS, filter_parameters, run_filter
from orientation_filters.result import JAMMED
from orientation_filters.rotation.arrays import (
    conjugate,
    heading_angle,
    inclination_angle,
    multiply,
    normalised,
    rotate,
    rotation_angle,
)
from orientation_filters.sample_checks import Sample
from verdict import Verdict

from imu_recording import ImuRecording

ATTITUDES = 100
DIP = np.radians(50.0)
FIELD_T = 50e-6
SIGMAS = {'rate': 9.1385e-5**0.5, 'force': 1.9247e-4**0.5, 'field': 0.1**0.5 * 1e-6}
"""rad/s, m/s², T."""
BIAS_SIGMA = np.radians(0.3)


def vectors(world_frame: str) -> tuple[FloatArray, FloatArray]:
    """Return specific force [m/s²] and field [T] in the world."""
    level, sunk = FIELD_T * np.cos(DIP), FIELD_T * np.sin(DIP)
    if world_frame == 'ned':
        return np.array([0.0, 0.0, -9.81]), np.array([level, 0.0, sunk])
    return np.array([0.0, 0.0, 9.81]), np.array([0.0, level, -sunk])


def at_rest(
    seed: int, seconds: float, world_frame: str = 'enu'
) -> tuple[ImuRecording, FloatArray, FloatArray]:
    """Return a recording in a random attitude, that attitude and the gyroscope's bias."""
    rng = np.random.default_rng(seed)
    truth = normalised(rng.normal(size=4))
    bias = BIAS_SIGMA * rng.normal(size=3)
    n = round(seconds * 100)
    force, field = (rotate(conjugate(truth), v) for v in vectors(world_frame))
    recording = ImuRecording(
        stamp=1_000_000_000 + 10_000_000 * np.arange(n),
        angular_velocity=bias + SIGMAS['rate'] * rng.normal(size=(n, 3)),
        linear_acceleration=force + SIGMAS['force'] * rng.normal(size=(n, 3)),
        magnetic_field=field + SIGMAS['field'] * rng.normal(size=(n, 3)),
        temperature=np.full(n, 20.0),
    )
    return recording, truth, bias


def nine_axes(world_frame: str) -> list[Verdict]:
    """Judge attitude and bias of the AHRS as ahrsfilter has it."""
    error, bias_60, bias_300 = [], [], []
    for seed in range(ATTITUDES):
        recording, truth, bias = at_rest(seed, 300.0, world_frame)
        result = run_filter('ahrs', recording, world_frame=world_frame)
        apart = rotation_angle(multiply(conjugate(truth), result.orientation[[5999, -1]]))
        error.append(np.degrees(apart))
        bias_60.append(np.degrees(result.bias[5999] - bias))
        bias_300.append(np.degrees(result.bias[-1] - bias))
    label = f'static {world_frame.upper()}, {ATTITUDES} attitudes'
    at_60, at_300 = np.percentile(error, 95, axis=0)
    return [
        Verdict(f'{label}: error at 60 s, 95 %', float(at_60), 0.3, '°'),
        Verdict(f'{label}: error at 300 s, 95 %', float(at_300), 0.3, '°'),
        Verdict(f'{label}: bias at 60 s, rms', _rms(bias_60), 0.06, '°/s'),
        Verdict(f'{label}: bias at 60 s, 95 %', _most(bias_60), 0.06, '°/s'),
        Verdict(f'{label}: bias at 300 s, rms', _rms(bias_300), 0.025, '°/s'),
    ]


def six_axes() -> list[Verdict]:
    """Judge what gravity alone shows: inclination and two components of the bias."""
    tilt, level_60, level_300 = [], [], []
    for seed in range(ATTITUDES):
        recording, truth, bias = at_rest(seed, 300.0)
        result = run_filter('ahrs', recording, use_magnetometer=False)
        between = multiply(result.orientation[-1], conjugate(truth))
        tilt.append(np.degrees(inclination_angle(between)))
        for found, row in ((level_60, 5999), (level_300, -1)):
            found.append(np.degrees(rotate(truth, result.bias[row] - bias)[:2]))
    return [
        Verdict('six axes: inclination at 300 s, 95 %', float(np.percentile(tilt, 95)), 0.3, '°'),
        Verdict('six axes: horizontal bias at 60 s, 95 %', _most(level_60), 0.06, '°/s'),
        Verdict('six axes: horizontal bias at 300 s, rms', _rms(level_300), 0.025, '°/s'),
    ]


def jam() -> Verdict:
    """Judge whether the jam flag is the comparison with twice the field, to rounding."""
    params = filter_parameters('ahrs').kernel_params()
    recording, _, _ = at_rest(1, 20.0)
    state = initial_state()
    columns = (recording.angular_velocity, recording.linear_acceleration, recording.magnetic_field)
    for stamp, *row in zip(recording.stamp.tolist(), *columns, strict=True):
        state, _ = update(state, params, Sample(stamp, *map(tuple, row)))
    w, f, m = (column[-1] for column in columns)
    wrong, tripped = 0, 0
    for extra in np.linspace(0.0, 400e-6, 4001):
        seen = tuple(m + np.array([extra, 0.0, 0.0]))
        sample = Sample(stamp + 10_000_000, tuple(w), tuple(f), seen)
        after, estimate = update(state, params, sample)
        is_long = np.linalg.norm(after.magnetic_disturbance) > 2.0 * params.field_strength
        wrong += bool(estimate.flags & JAMMED) != bool(is_long)
        tripped += bool(estimate.flags & JAMMED)
    return Verdict('jam unlike ‖d‖ > 2B, of 4001 disturbances', wrong if tripped else np.nan, 0)


def magnet() -> list[Verdict]:
    """Judge the heading during 60 s beside a magnet of 200 µT, any direction, robust presets."""
    verdicts = []
    for name in FILTERS:
        worst = 0.0
        for seed in range(20):
            recording, *_ = at_rest(seed, 120.0)
            push = np.random.default_rng(seed).normal(size=3)
            field = recording.magnetic_field.copy()
            field[6000:] += 200e-6 * push / np.linalg.norm(push)
            disturbed = replace(recording, magnetic_field=field)
            q = run_filter(name, disturbed, preset='robust').orientation
            turned = heading_angle(multiply(q[6000:], conjugate(q[5999])))
            worst = max(worst, float(np.degrees(turned.max())))
        claim = f'{name} robust: heading drift in 60 s of 200 µT at rest, worst of 20'
        verdicts.append(Verdict(claim, worst, 2.0, '°'))
    return verdicts


def filterpy_agrees() -> Verdict:
    """Judge the largest difference to filterpy's formulation."""
    worst = 0.0
    for preset in ('paper', 'robust'):
        recording, _, _ = at_rest(5, 20.0)
        native = run_filter('ahrs', recording, preset=preset)
        other = run_filter('ahrs', recording, preset=preset, implementation='filterpy')
        for name in ('orientation', 'packed_covariance', 'bias'):
            apart = np.abs(getattr(native, name) - getattr(other, name))
            worst = max(worst, float(apart.max()))
    return Verdict('AHRS against its formulation on filterpy, largest difference', worst, 1e-9)


def static() -> list[Verdict]:
    """Return every verdict."""
    return [
        *nine_axes('enu'),
        *nine_axes('ned'),
        *six_axes(),
        jam(),
        *magnet(),
        filterpy_agrees(),
    ]


def _most(errors: list[FloatArray]) -> float:
    return float(np.percentile(np.abs(errors), 95))


def _rms(errors: list[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))
