# SPDX-License-Identifier: Apache-2.0
"""Faults of the die thermometer and of the clock, each with its consequence for a fit.

Seen in logs of autopilots: no value, always the same one, whole degrees, another sensor's values,
a wrong scale, stamps in steps as long as the samples' distance. A stream is checked for a copy and
a wrong scale, too, over its newest hours.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from imu_recording.logging_contract import THERMOMETER_FIELDS
from imu_recording.recording import FloatArray, ImuRecording
from imu_recording.thermometer import (
    FEWEST_MEASUREMENTS,
    LEAST_MISSING_ROWS,
    LONGEST_CONSTANT_S,
    is_constant,
    is_whole_degrees,
)

from thermal_comp.data.defective_rows import BoolArray
from thermal_comp.data.rounding import coarse_counts, some_rows
from thermal_comp.effects.operators import follow
from thermal_comp.linear.columns import orthonormal, project_out

THERMOMETERS_NEAREST_FIRST = sorted(
    THERMOMETER_FIELDS, key=lambda name: name != 'device_temperature'
)
"""Other thermometers, that at the device before those in the chamber's air."""
MISSING_SHARE = 0.005
"""Share of rows without a temperature from which that is a fault."""
POSSIBLE_DIES_S = (1e-3, 30.0, 90.0, 240.0, 500.0, 950.0, 1800.0)
"""Time constants that a die may have behind the temperature around it [s]."""
MOST_DIE_ROWS = 50_000
"""Rows in which they are followed; a die moves slowly."""
LEAST_DIE_CHANGE_K = 1.0
"""Change of every possible die, beyond the counts of the thermometer, during which one that stands
still has failed [K]."""
COPIED_SHARE = 0.9
"""Share of values equal, bit for bit, to another sensor's from which they are copied from it."""
LEAST_COPIED_VALUES = 10
"""Different values it takes, at least: fewer may be equal by chance."""
POSSIBLE_SCALES = (0.7, 1.4)
"""Least and greatest change of a die per change of the temperature around it [K/K]."""
LEAST_SCALE_SPAN_K = 10.0
"""Change of the temperature around the device from which that ratio is told [K]."""
LEAST_FOLLOWED_SHARE = 0.8
"""Share of the die's variance that has to follow the temperature around it."""
DIE_LAGS_S = (0.0, *np.geomspace(30.0, 1800.0, 24).tolist())
"""Time constants with which the die may follow it [s]."""
WARM_UP_TIMES_S = (60.0, 300.0)
"""Time constants of the die's own warmth after power-on [s]."""
LEAST_MISFIT_RATIO = 4.0
"""Least ratio of the variance that all possible scales leave to that of a wrong one."""
LEAST_SCATTER_SHARE = 0.04
"""Least share of the die's scatter that possible scales leave where the scale is wrong: a die is
more than one thermal node."""
CLOCK_STEPS_NS = (1_000_000_000, 100_000_000, 10_000_000, 1_000_000)
"""Resolutions of a clock that are tried [ns]."""
COARSE_STEP_SHARE = 0.2
"""Share of the samples' distance from which a resolution is coarse."""
UNEVEN_INTERVAL_SHARE = 0.02
"""Least share of the intervals that such a clock makes longer or shorter than most."""
STREAM_ROW_NS = 1_000_000_000
"""Distance of the rows that are kept of a stream [ns]."""
MOST_STREAM_ROWS = 4 * 3600
"""Rows that are kept of it: enough for a ramp of a chamber, or a warm-up."""
LEAST_CHECKED_ROWS = 60
"""Rows of a stream from which it is checked."""
LEAST_NEW_SHARE = 0.1
"""Share of new rows after which it is checked again."""


@dataclass(frozen=True, eq=False)
class InstrumentFault:
    """A fault of thermometer or clock in one recording."""

    name: str
    rows: BoolArray
    """(n,) rows concerned."""
    text: str
    """The fault, and its consequence for a fit."""
    unusable: bool = False
    """Whether the temperature of these rows is left out."""


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
    if lost.sum() >= max(LEAST_MISSING_ROWS, MISSING_SHARE * len(values)):
        text = f'no temperature in {int(lost.sum())} of {len(values)} rows: they fit nothing'
        yield InstrumentFault('thermometer_missing', lost, text)
    measured = _measured(recording)
    if len(measured) < FEWEST_MEASUREMENTS:
        return
    if is_constant(measured):
        span = recording.time[[0, -1]]
        if span[1] >= LONGEST_CONSTANT_S or _would_move(
            _possible_dies(recording), span, LEAST_DIE_CHANGE_K
        ):
            text = f'always {measured[0]:g} °C: no dependence on temperature can be fitted'
            yield InstrumentFault('thermometer_constant', every, text)
        return
    stuck = stuck_temperature(recording)
    if stuck.any():
        text = (
            f'one value in {int(stuck.sum())} rows while the chamber changes: they are left out, '
            'as they would bend every curve'
        )
        yield InstrumentFault('thermometer_constant', stuck, text, unusable=True)
    if is_whole_degrees(measured):
        text = (
            'temperature in whole degrees: slopes keep their value, but lag, hysteresis and what '
            'else follows the rate of change are lost in steps of 1 K'
        )
        yield InstrumentFault('thermometer_whole_degrees', every, text)
    if source := copied_from(recording):
        text = (
            f'temperature is a copy of {source}: the difference between the two is fitted as a lag'
        )
        yield InstrumentFault('thermometer_copied', every, text)
        return
    if ratio := wrong_scale(recording):
        text = (
            f'the die moves {ratio:.2g} K for each kelvin around it: all slopes are '
            f'{1.0 / ratio:.2g} times as large, and hold for this scale alone'
        )
        yield InstrumentFault('thermometer_scale', every, text)


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
    if len(long):
        dies = _possible_dies(recording)
        least = LEAST_DIE_CHANGE_K + float(coarse_counts(values[:, None])[0])
        for start, stop in zip(edges[long].tolist(), edges[long + 1].tolist(), strict=True):
            stuck[start:stop] = _would_move(dies, recording.time[[start, stop - 1]], least)
    return stuck & np.isfinite(values)


def _possible_dies(recording: ImuRecording) -> list[tuple[FloatArray, FloatArray]]:
    """Return times (m,) and temperatures (m, d) of possible dies at each other thermometer.

    Between two bursts a fast one may have come back to where it was, a slow one not; at the end of
    a ramp one of them turns.
    """
    made = []
    for track in (getattr(recording, name) for name in THERMOMETER_FIELDS):
        if track is not None and (known := np.isfinite(track)).any():
            time = recording.time[:: max(1, len(recording) // MOST_DIE_ROWS)]
            around = np.interp(time, recording.time[known], track[known])
            dies = [follow(time, around, lag, held=True)[0] for lag in POSSIBLE_DIES_S]
            made.append((time, np.stack(dies, axis=1)))
    return made


def _would_move(dies: list[tuple[FloatArray, FloatArray]], span: FloatArray, least: float) -> bool:
    """Tell whether all dies at some thermometer would move by more than that from a to b [s]."""
    for time, temperature in dies:
        within = temperature[
            slice(*np.searchsorted(time, [span[0], np.nextafter(span[1], np.inf)]))
        ]
        if len(within) and bool((np.ptp(within, axis=0) > least).all()):
            return True
    return False


def copied_from(recording: ImuRecording) -> str:
    """Return the track whose values the die thermometer has, '' where it has its own."""
    values = recording.temperature
    for name in THERMOMETER_FIELDS:
        track = getattr(recording, name)
        if track is None:
            continue
        known = np.isfinite(values) & np.isfinite(track)
        if (
            known.sum() < FEWEST_MEASUREMENTS
            or len(np.unique(values[known])) < LEAST_COPIED_VALUES
        ):
            continue
        if float((values[known] == track[known]).mean()) > COPIED_SHARE:
            return name
    return ''


def wrong_scale(recording: ImuRecording) -> float:
    """Return the change of the die per kelvin around it where it is impossible, else 0 [K/K]."""
    for name in THERMOMETERS_NEAREST_FIRST:
        track = getattr(recording, name)
        if track is None:
            continue
        rows = some_rows(len(recording), 5000)
        around, die, time = track[rows], recording.temperature[rows], recording.time[rows]
        known = np.isfinite(around) & np.isfinite(die)
        around, die, time = around[known], die[known], time[known]
        if (
            len(die) < FEWEST_MEASUREMENTS
            or np.ptp(around) < LEAST_SCALE_SPAN_K
            or np.ptp(die) == 0.0
        ):
            continue
        return _impossible_scale(around, die, time)
    return 0.0


def _impossible_scale(around: FloatArray, die: FloatArray, time: FloatArray) -> float:
    """Return the scale of a die (n,) over the temperature around it; 0 where a possible one fits.

    The die follows with some lag, its own warmth after power-on beside it.
    """
    period, since = float(np.median(np.diff(time))), time - time[0]
    warming = [np.exp(-since / seconds) for seconds in WARM_UP_TIMES_S]
    free, possible = [], []
    for lag in DIE_LAGS_S:
        start = np.exp(-since / max(lag, period))  # the die may not start where its air does
        beside = orthonormal(np.stack([np.ones(len(time)), start, *warming], axis=1))
        lagged = follow(time, around, lag, held=True)[0] if lag else around
        both = np.stack([die, lagged], axis=1)
        moved, followed = project_out(beside, both).T
        power = max(float(followed @ followed), 1e-12)
        ratio = float(followed @ moved) / power
        near = float(np.clip(ratio, *POSSIBLE_SCALES))
        left = float(moved @ moved) - ratio**2 * power
        free.append((left, ratio))
        possible.append(left + (ratio - near) ** 2 * power)
    (least, ratio), best = min(free), min(possible)
    scatter = float(((die - die.mean()) ** 2).sum())
    follows = least < (1.0 - LEAST_FOLLOWED_SHARE) * scatter
    impossible = best > max(LEAST_MISFIT_RATIO * least, LEAST_SCATTER_SHARE**2 * scatter)
    return ratio if follows and impossible else 0.0


def _clock(recording: ImuRecording) -> Iterator[InstrumentFault]:
    if len(recording) < FEWEST_MEASUREMENTS:
        return
    intervals = np.diff(recording.stamp)
    usual = float(np.median(intervals))
    for step in CLOCK_STEPS_NS:
        if ((recording.stamp - recording.stamp[0]) % step).any():
            continue
        uneven = np.abs(intervals - usual) >= step
        if step >= COARSE_STEP_SHARE * usual and uneven.mean() > UNEVEN_INTERVAL_SHARE:
            text = (
                f'stamps in steps of {step * 1e-6:g} ms, samples {usual * 1e-6:.3g} ms apart: '
                'densities of noise and lags are wrong by as much'
            )
            rows = np.append(uneven, False)
            yield InstrumentFault('coarse_clock', rows, text)
        return


class ThermometerComparison:
    """Takes in values of all thermometers as they come; `fault` says what is wrong with the die's.

    A row is kept when the next one is due: by then the others' values up to its stamp are here.
    """

    def __init__(self) -> None:
        self.fault = ''
        """What is wrong with the die's thermometer; '' where nothing speaks against it."""
        self._rows: deque[tuple[int, float, tuple[float, ...]]] = deque(maxlen=MOST_STREAM_ROWS)
        self._waiting: tuple[int, float] | None = None
        self._others: dict[str, deque[tuple[int, float]]] = {
            name: deque(maxlen=64) for name in THERMOMETER_FIELDS
        }
        self._new = 0

    def on_other(self, name: str, stamp: int, temperature: float) -> None:
        """Take in a value [°C] of one of THERMOMETER_FIELDS, measured at `stamp` [ns]."""
        self._others[name].append((stamp, temperature))

    def on_die(self, stamp: int, temperature: float) -> None:
        """Take in a die temperature [°C] measured at `stamp` [ns]."""
        if self._waiting is None or stamp < self._waiting[0]:  # the first, or the clock jumped
            self._rows.clear()
            self._waiting = stamp, temperature
        elif stamp >= self._waiting[0] + STREAM_ROW_NS:
            then = self._waiting[0]
            others = tuple(self._value(name, then) for name in THERMOMETER_FIELDS)
            if not np.isnan(others).all():
                self._rows.append((*self._waiting, others))
                self._new += 1
            self._waiting = stamp, temperature
            if self._new >= max(LEAST_CHECKED_ROWS, LEAST_NEW_SHARE * len(self._rows)):
                self._new = 0
                self.fault = self._checked()

    def _value(self, name: str, stamp: int) -> float:
        """Return the newest value not later than `stamp`; NaN where there is none."""
        known = (value for then, value in reversed(self._others[name]) if then <= stamp)
        return next(known, np.nan)

    def _checked(self) -> str:
        stamp, die, others = zip(*self._rows, strict=True)
        unknown = np.full((len(stamp), 3), np.nan)
        tracks = np.array(others).T
        recording = ImuRecording(
            stamp=np.array(stamp, np.int64),
            angular_velocity=unknown,
            linear_acceleration=unknown,
            magnetic_field=unknown,
            temperature=np.array(die),
            **dict(zip(THERMOMETER_FIELDS, tracks, strict=True)),
        )
        if source := copied_from(recording):
            return f'the die temperature is a copy of {source}'
        if ratio := wrong_scale(recording):
            return f'the die moves {ratio:.2g} K for each kelvin around it: its scale is wrong'
        return ''
