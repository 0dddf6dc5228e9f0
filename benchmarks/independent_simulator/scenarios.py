# SPDX-License-Identifier: Apache-2.0
"""Recordings as people make them: in a laboratory's chamber, a freezer, a room, with a dryer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from independent_simulator.device import Logger
from independent_simulator.surroundings import UP, Programme, Segment

CHAMBER_TRACKS = {
    'chamber_temperature': 0.9,
    'chamber_temperature_2': 0.35,
    'device_temperature': 0.5,
    'setpoint': 0.8,
    'humidity': 0.4,
    'heater': 0.6,
    'compressor': 0.6,
    'fan': 0.3,
    'supply_voltage': 0.5,
    'vibration': 0.6,
    'phase': 0.6,
}
"""Share of laboratories that log a track."""
EVERYDAY_TRACKS = {
    'chamber_temperature': 0.15,
    'device_temperature': 0.15,
    'humidity': 0.1,
    'supply_voltage': 0.25,
    'vibration': 0.3,
}


@dataclass(frozen=True)
class Plan:
    """What is recorded and how."""

    programmes: tuple[Programme, ...]
    loggers: tuple[Logger, ...]
    tracks: Mapping[str, float] = field(default_factory=lambda: EVERYDAY_TRACKS)
    ranges: bool = False
    """Every run has a full scale of its own."""


Scenario = Callable[[np.random.Generator], Plan]


def _cycles(
    rng: np.random.Generator, count: int, precondition: tuple[float, float], final: float
) -> list[Segment]:
    """Return a chamber's programme: reference, cold, hot, reference, `count` times."""
    rate = rng.uniform(1.0, 3.0) / 60.0
    cold, hot = rng.uniform(-20.0, 0.0), rng.uniform(40.0, 60.0)
    dwell = 60.0 * rng.uniform(20.0, 40.0)
    segments = [Segment(60.0 * rng.uniform(*precondition), 20.0, 0)]
    for cycle in range(1, count + 1):
        segments += [
            Segment((20.0 - cold) / rate, cold, 1, cycle),
            Segment(dwell, cold, 2, cycle),
            Segment((hot - cold) / rate, hot, 3, cycle),
            Segment(dwell, hot, 4, cycle),
            Segment((hot - 20.0) / rate, 20.0, 1, cycle),
            Segment(dwell, 20.0, 5, cycle),
        ]
    return [*segments, Segment(final, 20.0, 6)] if final else segments


def _cut(segments: Sequence[Segment], end: float) -> list[Segment]:
    """Return the programme up to a time [s]; a ramp cut short stops where it is."""
    kept: list[Segment] = []
    level = 20.0
    for segment in segments:
        room = end - sum(one.duration for one in kept)
        if room <= 0.0:
            break
        share = min(1.0, room / segment.duration)
        target = level + share * (segment.target - level)
        kept.append(Segment(segment.duration * share, target, segment.phase, segment.cycle))
        level = target
    return kept


def _logger(rng: np.random.Generator) -> Logger:
    """Return a laboratory's: means of one or five seconds, sometimes samples."""
    return Logger(float(rng.choice([1.0, 5.0])), bool(rng.random() < 0.8))


def _chamber(
    rng: np.random.Generator,
    programmes: Sequence[list[Segment]],
    poses: Sequence[str],
    keep: Sequence[tuple[tuple[float, float], ...]] = (),
    tracks: Mapping[str, float] = CHAMBER_TRACKS,
    ranges: bool = False,
) -> Plan:
    logger = _logger(rng)
    begins, runs = 0.0, []
    for segments, pose in zip(programmes, poses, strict=True):
        runs.append(Programme('chamber', tuple(segments), 20.0, begins, pose, 1.0))
        begins += sum(one.duration for one in segments) + 3600.0 * rng.uniform(0.3, 12.0)
    kept = keep or [()] * len(runs)
    loggers = tuple(Logger(logger.period, logger.averaging, keep=one) for one in kept)
    return Plan(tuple(runs), loggers, tracks, ranges)


def _poses(rng: np.random.Generator, count: int) -> list[str]:
    if count == 3 and rng.random() < 0.6:
        return ['+x', '+y', '+z']
    return [str(pose) for pose in rng.choice(list(UP), count, replace=False)]


def full_lab(rng: np.random.Generator) -> Plan:
    """Three orientations, four cycles each, about 11.5 h."""
    segments = _cycles(rng, 4, (30.0, 90.0), 1800.0)
    return _chamber(rng, [segments] * 3, _poses(rng, 3))


def two_cycles_one_pose(rng: np.random.Generator) -> Plan:
    return _chamber(rng, [_cycles(rng, 2, (5.0, 30.0), 0.0)], _poses(rng, 1))


def aborted(rng: np.random.Generator) -> Plan:
    """Three runs of two, three and two cycles, cut short within the next."""
    whole = _cycles(rng, 4, (10.0, 40.0), 0.0)
    cycle = sum(one.duration for one in whole if one.cycle == 1)
    programmes = [
        _cut(whole, whole[0].duration + (count + rng.uniform(0.0, 0.6)) * cycle)
        for count in (2, 3, 2)
    ]
    return _chamber(rng, programmes, _poses(rng, 3))


def with_gaps(rng: np.random.Generator) -> Plan:
    """Two or three runs in which minutes to an hour are missing."""
    count = int(rng.integers(2, 4))
    segments = _cycles(rng, int(rng.integers(2, 4)), (10.0, 40.0), 0.0)
    span = sum(one.duration for one in segments)
    keep = []
    for _ in range(count):
        edges = np.sort(rng.uniform(0.05, 0.95, int(rng.integers(1, 4)))) * span
        stops = np.minimum(edges + 60.0 * rng.uniform(2.0, 60.0, len(edges)), span)
        keep.append(tuple(zip([0.0, *stops.tolist()], [*edges.tolist(), span], strict=True)))
    return _chamber(rng, [segments] * count, _poses(rng, count), keep)


def different_ranges(rng: np.random.Generator) -> Plan:
    """Three runs of two cycles, each with full scales of its own."""
    segments = _cycles(rng, 2, (10.0, 40.0), 0.0)
    return _chamber(rng, [segments] * 3, _poses(rng, 3), ranges=True)


def no_chamber_channels(rng: np.random.Generator) -> Plan:
    """Only the IMU was recorded."""
    count = int(rng.integers(2, 4))
    segments = _cycles(rng, int(rng.integers(2, 4)), (10.0, 40.0), 0.0)
    return _chamber(rng, [segments] * count, _poses(rng, count), tracks={})


def irrelevant_channels(rng: np.random.Generator) -> Plan:
    """Everything was logged, whether it acts or not."""
    count = int(rng.integers(2, 4))
    segments = _cycles(rng, int(rng.integers(2, 4)), (10.0, 40.0), 0.0)
    every = dict.fromkeys(CHAMBER_TRACKS, 1.0)
    return _chamber(rng, [segments] * count, _poses(rng, count), tracks=every)


def single_sweep(rng: np.random.Generator) -> Plan:
    """Once up and down, or down and up, in one to three hours, in one pose."""
    cold, hot = rng.uniform(-20.0, 5.0), rng.uniform(40.0, 65.0)
    turns = [cold, hot] if rng.random() < 0.6 else [hot, cold]
    corners = [*turns, 20.0] if rng.random() < 0.5 else turns
    paths = np.abs(np.diff([20.0, *corners]))
    whole = 3600.0 * rng.uniform(1.0, 3.0)
    dwell = whole * rng.uniform(0.02, 0.12)
    rate = paths.sum() / (whole - (1 + len(corners)) * dwell)
    segments = [Segment(dwell, 20.0)]
    for path, corner in zip(paths, corners, strict=True):
        segments += [Segment(path / rate, corner), Segment(dwell, corner)]
    return _chamber(rng, [segments], _poses(rng, 1))


def cold_start_20min(rng: np.random.Generator) -> Plan:
    """Out of the freezer, switched on, and left to reach the room's temperature."""
    count = int(rng.choice([1, 1, 1, 2, 3]))
    begins, runs = 0.0, []
    pose = _poses(rng, 1)[0]
    for _ in range(count):
        segments = (Segment(1.0, 22.0), Segment(60.0 * rng.uniform(15.0, 30.0), 22.0))
        start = rng.uniform(-20.0, -5.0)
        runs.append(Programme('freezer', segments, start, begins, pose, 0.5))
        begins += 3600.0 * rng.uniform(3.0, 24.0)
    period = float(rng.choice([1.0, 1.0, 0.1, 0.02]))
    logger = Logger(period, period == 1.0 and bool(rng.random() < 0.5), jitter=0.1)
    return Plan(tuple(runs), (logger,) * count)


def hair_dryer(rng: np.random.Generator) -> Plan:
    """Warmed one to three times with a hair-dryer, ten to 25 min at 50 … 100 Hz."""
    count = int(rng.integers(1, 4))
    whole = 60.0 * rng.uniform(10.0, 25.0)
    warm = whole * rng.uniform(0.2, 0.4) / count
    cool = (whole - count * warm) / (count + 1)
    segments = [Segment(cool, 22.0)]
    for _ in range(count):
        hot = rng.uniform(45.0, 75.0)
        segments += [
            Segment(2.0, hot),
            Segment(warm, hot),
            Segment(2.0, 22.0),
            Segment(cool, 22.0),
        ]
    run = Programme('dryer', tuple(segments), 22.0, 0.0, _poses(rng, 1)[0], 0.2)
    logger = Logger(
        float(rng.choice([0.01, 0.02])), False, 0.05, magnetometer_every=int(rng.choice([1, 5]))
    )
    return Plan((run,), (logger,))


def _room(rng: np.random.Generator, days: float, dt: float) -> Programme:
    level = rng.uniform(18.0, 26.0)
    corners = max(2, round(2 * days))
    segments = [
        Segment(days * 86400.0 / corners, level + rng.uniform(-2.5, 2.5)) for _ in range(corners)
    ]
    return Programme('room', tuple(segments), level, 0.0, _poses(rng, 1)[0], dt)


def several_days(rng: np.random.Generator) -> Plan:
    """Two to four days on a shelf, a row every ten seconds."""
    run = _room(rng, rng.uniform(2.0, 4.0), 10.0)
    return Plan((run,), (Logger(10.0, bool(rng.random() < 0.5)),))


def bursts(rng: np.random.Generator) -> Plan:
    """Five seconds at 50 Hz, every ten minutes to every hour, for one to three days."""
    every = 60.0 * float(rng.choice([10.0, 15.0, 30.0, 60.0]))
    if rng.random() < 0.5:
        run = _room(rng, rng.uniform(1.0, 3.0), 2.0)
    else:
        slow = _cycles(rng, int(rng.integers(2, 5)), (30.0, 60.0), 0.0)
        stretch = float(rng.uniform(2.0, 4.0))
        segments = [
            Segment(one.duration * stretch, one.target, one.phase, one.cycle) for one in slow
        ]
        run = Programme('chamber', tuple(segments), 20.0, 0.0, _poses(rng, 1)[0], 2.0)
    span = sum(one.duration for one in run.segments)
    starts = np.arange(0.0, span - 5.0, every)
    keep = tuple((float(start), float(start) + 5.0) for start in starts)
    return Plan((run,), (Logger(0.02, False, 0.05, keep),))


SCENARIOS: Mapping[str, Scenario] = {
    scenario.__name__: scenario
    for scenario in (
        full_lab,
        single_sweep,
        cold_start_20min,
        hair_dryer,
        two_cycles_one_pose,
        several_days,
        aborted,
        with_gaps,
        bursts,
        different_ranges,
        no_chamber_channels,
        irrelevant_channels,
    )
}
