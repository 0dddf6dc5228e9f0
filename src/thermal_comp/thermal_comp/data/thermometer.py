# SPDX-License-Identifier: Apache-2.0
"""Faults of the die thermometer and of the clock, each with its consequence for a fit.

Seen in logs of autopilots: no value, always the same one, whole degrees, another sensor's values,
a scale of its own, stamps in steps as long as the samples' distance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from imu_recording.logging_contract import THERMOMETER_FIELDS
from imu_recording.recording import FloatArray, ImuRecording
from imu_recording.thermometer import (
    CONSTANT_S,
    FEWEST_MEASUREMENTS,
    MISSING_ROWS,
    is_constant,
    is_whole_degrees,
)

from thermal_comp.data.defective_rows import BoolArray, some_rows
from thermal_comp.effects.operators import follow
from thermal_comp.linear.columns import orthonormal, project_out

MISSING_SHARE = 0.005
"""Rows without a temperature are a fault from this share of all."""
SLOWEST_DIE_S = 1800.0
"""No die follows its surroundings with a longer time constant [s]."""
DIE_MOVES = 1.0
"""A thermometer that stands still while the fastest and the slowest die would move by so much has
failed [K]."""
COPIED_SHARE = 0.9
"""Share of a thermometer's values that are, bit for bit, another sensor's of the time."""
COPIED_VALUES = 10
"""Different values from which such equality is no chance."""
SCALE = (0.7, 1.4)
"""Kelvins of the die for one of its surroundings: a device that warms them up has 1."""
SCALE_SPAN = 10.0
"""Change of the surroundings from which that ratio is judged [K]."""
SCALE_FIT = 0.8
"""Least share of the die's variance that follows the surroundings."""
LAGS_S = (0.0, *np.geomspace(30.0, 1800.0, 24).tolist())
"""The die follows with one of these time constants, or one near [s] …"""
WARMING_S = (60.0, 300.0)
"""… and warms by itself after power-on with these."""
SCALE_MISFIT = 4.0
"""A scale is wrong where every one that may be leaves so many times the variance …"""
SCALE_LEFT = 0.04
"""… and this share of the die's scatter: the die is no single node."""
CLOCK_STEPS_NS = (1_000_000_000, 100_000_000, 10_000_000, 1_000_000)
"""Resolutions of a clock that are looked for [ns]."""
CLOCK_SHARE = 0.2
"""A resolution of so much of the samples' distance is coarse."""
UNEVEN_SHARE = 0.02
"""So many intervals are then longer or shorter than most."""


@dataclass(frozen=True, eq=False)
class InstrumentFault:
    """A fault of thermometer or clock in one recording."""

    name: str
    rows: BoolArray
    """(n,) rows concerned."""
    unusable: bool
    """Whether the temperature of these rows is left out."""
    text: str
    """What is wrong, and what that does to a fit."""


def instrument_faults(recording: ImuRecording) -> list[InstrumentFault]:
    """Return the faults of thermometer and clock."""
    return [*_clock(recording), *_thermometer(recording)]


def _thermometer(recording: ImuRecording) -> Iterator[InstrumentFault]:
    every = np.ones(len(recording), dtype=bool)
    values = recording.temperature
    known = np.isfinite(values)
    if not known.any():
        return  # one clear error elsewhere
    lost = ~known
    lost[: int(np.argmax(known))] = False  # nothing was measured yet
    if lost.sum() >= max(MISSING_ROWS, MISSING_SHARE * len(values)):
        text = f'no temperature in {int(lost.sum())} of {len(values)} rows: they fit nothing'
        yield InstrumentFault('thermometer_missing', lost, False, text)
    measured = _measured(recording)
    if len(measured) < FEWEST_MEASUREMENTS:
        return
    if is_constant(measured):
        if recording.time[-1] >= CONSTANT_S or _moved(_possible_dies(recording), every):
            text = f'always {measured[0]:g} °C: no dependence on temperature can be fitted'
            yield InstrumentFault('thermometer_constant', every, False, text)
        return
    stuck = stuck_temperature(recording)
    if stuck.any():
        text = (
            f'one value in {int(stuck.sum())} rows while the chamber changes: they are left out, '
            'as they would bend every curve'
        )
        yield InstrumentFault('thermometer_constant', stuck, True, text)
    if is_whole_degrees(measured):
        text = (
            'temperature in whole degrees: slopes keep their value, but lag, hysteresis and what '
            'else follows the rate of change drown in steps of 1 K'
        )
        yield InstrumentFault('thermometer_whole_degrees', every, False, text)
    if source := copied_from(recording):
        text = f'temperature is a copy of {source}: what lies between the two is fitted as a lag'
        yield InstrumentFault('thermometer_copied', every, False, text)
        return
    if ratio := wrong_scale(recording):
        text = (
            f'the die moves {ratio:.2g} K for each kelvin around it: all slopes are '
            f'{1.0 / ratio:.2g} times as large, and hold for this scale alone'
        )
        yield InstrumentFault('thermometer_scale', every, False, text)


def _measured(recording: ImuRecording) -> FloatArray:
    """Return the measured values without the rows that repeat the newest one."""
    values, stamp = recording.temperature, recording.temperature_stamp
    if stamp is not None:
        values = values[np.flatnonzero(np.diff(stamp, prepend=stamp[:1] - 1))]
    return values[np.isfinite(values)]


def stuck_temperature(recording: ImuRecording) -> BoolArray:
    """Return the rows (n,) of one value during which every possible die would move."""
    values = recording.temperature
    stuck = np.zeros(len(values), dtype=bool)
    edges = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1, [len(values)]))
    long = np.flatnonzero(np.diff(edges) >= FEWEST_MEASUREMENTS)
    dies = _possible_dies(recording) if len(long) else []
    for start, stop in zip(edges[long].tolist(), edges[long + 1].tolist(), strict=True):
        if _moved(dies, slice(start, stop)):
            stuck[start:stop] = True
    return stuck & np.isfinite(values)


def _possible_dies(recording: ImuRecording) -> list[FloatArray]:
    """Return (n, 2) temperature of the fastest and the slowest die in each logged surrounding.

    Between two bursts the fastest may have come back to where it was, the slowest not.
    """
    made = []
    for track in (getattr(recording, name) for name in THERMOMETER_FIELDS):
        if track is not None and (known := np.isfinite(track)).any():
            around = np.interp(recording.time, recording.time[known], track[known])
            slowest = follow(recording.time, around, SLOWEST_DIE_S, held=True)[0]
            made.append(np.stack([around, slowest], axis=1))
    return made


def _moved(dies: list[FloatArray], rows: slice | BoolArray) -> bool:
    """Tell whether both dies in some surroundings would move within the rows."""
    return any(bool((np.ptp(die[rows], axis=0) > DIE_MOVES).all()) for die in dies)


def copied_from(recording: ImuRecording) -> str:
    """Return the track that the thermometer repeats, '' where it is none."""
    values = recording.temperature
    for name in THERMOMETER_FIELDS:
        track = getattr(recording, name)
        if track is None:
            continue
        known = np.isfinite(values) & np.isfinite(track)
        if known.sum() < FEWEST_MEASUREMENTS or len(np.unique(values[known])) < COPIED_VALUES:
            continue
        if float((values[known] == track[known]).mean()) > COPIED_SHARE:
            return name
    return ''


def wrong_scale(recording: ImuRecording) -> float:
    """Return kelvins of the die per kelvin around it where that cannot be; 0 where it can."""
    for name in ('device_temperature', 'chamber_temperature'):
        track = getattr(recording, name)
        if track is None:
            continue
        rows = some_rows(len(recording), 5000)
        around, die, time = track[rows], recording.temperature[rows], recording.time[rows]
        known = np.isfinite(around) & np.isfinite(die)
        around, die, time = around[known], die[known], time[known]
        if len(die) < FEWEST_MEASUREMENTS or np.ptp(around) < SCALE_SPAN or np.ptp(die) == 0.0:
            continue
        return _scale_that_cannot_be(around, die, time)
    return 0.0


def _scale_that_cannot_be(around: FloatArray, die: FloatArray, time: FloatArray) -> float:
    """Return the die's scale (n,) over its surroundings; 0 where one that may be fits as well.

    The die follows with some lag, its own warmth after power-on beside it.
    """
    period, since = float(np.median(np.diff(time))), time - time[0]
    warming = [np.exp(-since / seconds) for seconds in WARMING_S]
    free, possible = [], []
    for lag in LAGS_S:
        start = np.exp(-since / max(lag, period))  # the die may not start where its air does
        beside = orthonormal(np.stack([np.ones(len(time)), start, *warming], axis=1))
        lagged = follow(time, around, lag, held=True)[0] if lag else around
        both = np.stack([die, lagged], axis=1)
        moved, followed = project_out(beside, both).T
        power = max(float(followed @ followed), 1e-12)
        ratio = float(followed @ moved) / power
        near = float(np.clip(ratio, *SCALE))
        left = float(moved @ moved) - ratio**2 * power
        free.append((left, ratio))
        possible.append(left + (ratio - near) ** 2 * power)
    (least, ratio), best = min(free), min(possible)
    scatter = float(((die - die.mean()) ** 2).sum())
    follows = least < (1.0 - SCALE_FIT) * scatter
    cannot_be = best > max(SCALE_MISFIT * least, SCALE_LEFT**2 * scatter)
    return ratio if follows and cannot_be else 0.0


def _clock(recording: ImuRecording) -> Iterator[InstrumentFault]:
    if len(recording) < FEWEST_MEASUREMENTS:
        return
    intervals = np.diff(recording.stamp)
    usual = float(np.median(intervals))
    for step in CLOCK_STEPS_NS:
        if ((recording.stamp - recording.stamp[0]) % step).any():
            continue
        uneven = np.abs(intervals - usual) >= step
        if step >= CLOCK_SHARE * usual and uneven.mean() > UNEVEN_SHARE:
            text = (
                f'stamps in steps of {step * 1e-6:g} ms, samples {usual * 1e-6:.3g} ms apart: '
                'densities of noise and lags are wrong by as much'
            )
            rows = np.append(uneven, False)
            yield InstrumentFault('coarse_clock', rows, False, text)
        return
