# SPDX-License-Identifier: Apache-2.0
"""Whether the numbers of a recording can be what a sensor on Earth measured in SI units.

Every verb, the Python interface, the import and the nodes check their input here: values that
cannot have been measured are refused in one line, which names the unit that would explain them;
a few damaged values are left out and counted. No thermal physics is assumed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from imu_recording.logging_contract import MEASURED_FIELDS, THERMOMETER_FIELDS, TRACK_OF_FIELD
from imu_recording.recording import (
    SENSOR_FIELDS,
    SENSOR_UNITS,
    STANDARD_GRAVITY,
    FloatArray,
    ImuRecording,
    RecordingError,
)

ACCEPTABLE_DEFECTS = ('units', 'compensated')
"""What a user may accept (`--accept`): implausible numbers, and data compensated before."""

POSSIBLE_RANGES = {
    'linear_acceleration': (-400.0, 400.0),
    'angular_velocity': (-70.0, 70.0),
    'magnetic_field': (-0.01, 0.01),
    'temperature': (-90.0, 200.0),
    'chamber_temperature': (-100.0, 300.0),
    'chamber_temperature_2': (-100.0, 300.0),
    'device_temperature': (-100.0, 300.0),
    'setpoint': (-100.0, 300.0),
    'humidity': (-0.05, 1.1),
    'pressure': (0.0, 2e7),
    'supply_voltage': (0.0, 60.0),
    'vibration': (0.0, 1e5),
}
"""Least and greatest value a field can hold [its unit]: twice the widest full scales of MEMS
sensors (16 and 24 g, 2000 °/s, 50 gauss), temperatures of working electronics and chambers, and
pressures from vacuum to two kilometres under water."""
LATER_JUDGED_FIELDS = (*MEASURED_FIELDS, 'humidity', 'supply_voltage', 'vibration')
"""Fields whose defects a diagnosis names itself (`sensors` False)."""
DAMAGED_SHARE = 0.01
"""Largest share of impossible values that is damage, which is left out; more is another unit."""
SINGLE_DAMAGED_SHARE = 0.2
"""The same where each stands alone between possible values, as a thermometer's error code does."""
FOREIGN_UNIT_RANGES = {
    'humidity': {'%': (1.1, 110.0)},
    'supply_voltage': {'mV': (1e3, 6e4)},
    'pressure': {'hPa': (300.0, 1100.0), 'kPa': (30.0, 110.0)},
}
"""Median values of air at inhabited heights, and of supplies, in other units that logs use."""

NORM_RANGES = {'accelerometer': (7.0, 13.0), 'magnetometer': (4e-6, 4e-4)}
"""Median norm [m/s², T]: gravity, whatever the attitude, and Earth's field of 22 … 67 µT with
hard iron of a few times its size."""
UNIT_FACTORS = {
    'accelerometer': {'g': 1.0 / STANDARD_GRAVITY, 'mg': 1e3 / STANDARD_GRAVITY, 'cm/s²': 100.0},
    'magnetometer': {'µT': 1e6, 'gauss': 1e4, 'mG': 1e7, 'nT': 1e9, 'mT': 1e3},
    'gyroscope': {'°/s': 180.0 / np.pi, 'm°/s': 180e3 / np.pi},
}
"""Factors from the SI unit to other units that logs use."""

REST_TURN_RAD = {'linear_acceleration': 0.1, 'magnetic_field': 0.8}
"""Change of the direction of gravity and of the field [rad] below which a device rests; for the
field larger, as heat changes the field of objects nearby."""
STILL_NORM_SHARE = 0.9
"""Least share of the norm that means over parts keep at rest; those over many turns keep less."""
QUIET_FORCE_STEP = 0.1
"""Median step of the specific force [m/s²] above which a resting device vibrates."""
LARGEST_REST_RATE = 0.6
"""Largest mean rate at rest [rad/s]: the zero-rate level of consumer gyroscopes is ±30 °/s."""
LARGEST_REST_STEP = 0.006
"""Largest median step at rest and without vibration [rad/s]: gyroscopes have 0.05 … 0.2 °/s."""
LARGEST_REST_DENSITY = 0.003
"""Largest such step times the root of the period [rad/s·√s]: 0.004 … 0.03 °/s/√Hz, and as much
again where single samples were logged."""
PREDICTING_ROWS = 8
"""Number of rows from which the next is predicted: a spectral line takes two."""
LARGEST_RATE_COUNT = 0.003
"""Largest count of a gyroscope [rad/s]: ±2000 °/s in 16 bits make 0.001, ±125 °/s taken as rad/s
0.0038."""
LEAST_DISTINCT_VALUES = 5
"""Least number of different values of an axis from which its counts are found."""
DENSITY_PERIOD_S = 2.0
"""Longest period whose noise density is compared [s]; slower rows may be of a wide band."""
FAHRENHEIT_EXCESS_K = 25.0
"""Least distance of a die temperature in °F above its chamber's, or the other way round [K]."""
CELSIUS_DISTANCE_K = 10.0
"""Largest distance from the other when it is converted [K]."""
FAHRENHEIT_SLOPE_RATIO = 1.2
"""Least ratio of its change to that of the other, unless that does not change."""
LEAST_CHAMBER_SPAN_K = 5.0
"""Span of the chamber's temperature from which the slope is compared [K]."""
HOTTEST_RATED_C = 105.0
"""Greatest temperature that MEMS sensors are rated for, 85 or 105 [°C]."""
COLDEST_F = 0.0
"""A recording beyond HOTTEST_RATED_C that stays above this is in °F (0 °F is −18 °C)."""
ROOM_RANGE_F = (60.0, 131.0)
"""Least and greatest temperature of a die switched on in a room, 15 … 55 °C, in °F."""
ROUND_STEP_TOLERANCE = 1e-3
"""Largest relative distance of a thermometer's step from a round one."""


def admitted(
    recording: ImuRecording, accept: Collection[str] = (), *, sensors: bool = True
) -> ImuRecording:
    """Return the recording, a few impossible values left out and counted; refuse a wrong one.

    `accept` names entries of ACCEPTABLE_DEFECTS that are not checked; `sensors` False leaves out
    the sensors, for callers that look for their defects themselves. Raises RecordingError in one
    line.
    """
    if recording.compensated and 'compensated' not in accept:
        raise RecordingError(
            f'{_name(recording)}: compensated already ({recording.compensated}); take the raw '
            'data, or tell to go on with --accept compensated'
        )
    if 'units' in accept:
        return recording
    recording, reason = assess(recording, sensors=sensors)
    if reason:
        raise RecordingError(
            f'{_name(recording)}: {reason}; convert it to SI units (in a CSV: unit of the '
            'mapping), leave it out (--topic NAME:= of a bag), or take it as it is with '
            '--accept units'
        )
    return recording


def assess(recording: ImuRecording, *, sensors: bool = True) -> tuple[ImuRecording, str]:
    """Return the recording without a few impossible values, and why it is refused, '' if not."""
    recording, reason = _without_damage(recording, sensors=sensors)
    reason = reason or _foreign_temperature(recording) or _foreign_pressure(recording)
    if sensors and not reason:
        reason = next(implausible(recording), '')
    hint = '' if reason else _hot_throughout(recording)
    return (recording.with_notes(hint) if hint else recording), reason


def possible(field: str, *values: float) -> bool:
    """Tell whether a field can hold these values; missing ones (NaN) can be anything.

    >>> possible('temperature', 21.5), possible('temperature', 293.15)
    (True, False)
    """
    low, high = POSSIBLE_RANGES[field]
    return not any(value < low or value > high for value in values)


def implausible(recording: ImuRecording) -> Iterator[str]:
    """Give a sentence on every sensor whose values have an implausible size."""
    for sensor, (low, high) in NORM_RANGES.items():
        size = _median_norm(getattr(recording, SENSOR_FIELDS[sensor]))
        if np.isfinite(size) and not low <= size <= high:
            yield _size_text(sensor, size)
    rate = rate_at_rest(recording)
    if rate:
        yield f'angular_velocity: {rate}'


def rate_at_rest(recording: ImuRecording) -> str:
    """Return what is wrong with the rates of a device at rest, '' where nothing is."""
    rate = recording.angular_velocity
    if not _rests(recording):
        return ''
    mean = float(np.linalg.norm(_median(rate)))
    seen = np.isfinite(recording.magnetic_field).any()  # else it may turn about the vertical
    if mean > LARGEST_REST_RATE and seen:
        return f'{mean:.3g} rad/s on average of a device at rest, as if in °/s'
    noise, shake = _step(rate), _step(recording.linear_acceleration)
    period = float(np.median(np.diff(recording.stamp))) * 1e-9
    dense = period <= DENSITY_PERIOD_S
    most = LARGEST_REST_DENSITY / period**0.5 if dense else LARGEST_REST_STEP
    if noise > most and shake < QUIET_FORCE_STEP and _unpredicted_step(rate) > most:
        return f'steps of {noise:.2g} rad/s from row to row of a device at rest, as if in °/s'
    count = max(map(_count, rate[:100_000].T))
    if count > LARGEST_RATE_COUNT:
        return f'counts of {count:.2g} rad/s, coarser than any gyroscope has, as if in °/s'
    return ''


def unit_of_norm(sensor: str, norm: float) -> str:
    """Return the unit that makes the norm of a sensor plausible, '' where none is needed or known.

    >>> unit_of_norm('accelerometer', 1.0), unit_of_norm('magnetometer', 0.45)
    ('g', 'gauss')
    """
    low, high = NORM_RANGES[sensor]
    if low <= norm <= high:
        return ''
    fits = (u for u, factor in UNIT_FACTORS[sensor].items() if low <= norm / factor <= high)
    return next(fits, '')


def _without_damage(recording: ImuRecording, *, sensors: bool) -> tuple[ImuRecording, str]:
    """Return the recording with single impossible values as NaN, and what has too many of them."""
    changed: dict[str, Any] = {}
    notes = []
    for field, (low, high) in POSSIBLE_RANGES.items():
        values = getattr(recording, field)
        if values is None or not len(values):
            continue
        with np.errstate(invalid='ignore'):
            wrong = (values < low) | (values > high)
        wrong_rows = wrong.reshape(len(values), -1).any(axis=1)
        rows = int(np.count_nonzero(wrong_rows))
        if not rows:
            continue
        worst = float(values[wrong][np.argmax(np.abs(values[wrong]))])
        topic = TRACK_OF_FIELD[field].topic
        together = int(np.count_nonzero(wrong_rows[1:] & wrong_rows[:-1]))
        if together > DAMAGED_SHARE * len(values) or rows > max(
            SINGLE_DAMAGED_SHARE * len(values), 1
        ):
            if not sensors and field in LATER_JUDGED_FIELDS:
                continue
            return recording, (
                f'{field} ({topic}) reaches {worst:.4g} in {rows} of {len(values)} rows, '
                f'possible is {low:g} … {high:g}{_guessed(recording, field)}'
            )
        values = np.where(wrong, np.nan, values)
        changed[field] = values
        notes.append(f'{field}: {rows} rows with impossible values (up to {worst:.3g}) left out')
    return (replace(recording, **changed).with_notes(*notes) if changed else recording), ''


def _guessed(recording: ImuRecording, field: str) -> str:
    if unit := _foreign_unit(field, recording):
        return f', as if in {unit}'
    sensor = next((s for s, name in SENSOR_FIELDS.items() if name == field), '')
    unit = (
        unit_of_norm(sensor, _median_norm(getattr(recording, field)))
        if sensor in NORM_RANGES
        else ''
    )
    return f', as if in {unit}' if unit else ''


def _foreign_unit(field: str, recording: ImuRecording) -> str:
    """Return the unit of FOREIGN_UNIT_RANGES that a track's numbers look like, '' for none."""
    values = getattr(recording, field)
    known = (
        values[np.isfinite(values)] if field in FOREIGN_UNIT_RANGES and values is not None else ()
    )
    middle = float(np.median(known)) if len(known) else np.nan
    units = FOREIGN_UNIT_RANGES.get(field, {}).items()
    return next((unit for unit, (low, high) in units if low <= middle <= high), '')


def _foreign_pressure(recording: ImuRecording) -> str:
    """Return what is wrong with a pressure in hPa: as Pa it would be that of the stratosphere."""
    unit = _foreign_unit('pressure', recording)
    if not unit or recording.pressure is None:
        return ''
    return f'pressure is {np.nanmedian(recording.pressure):.4g} Pa in the middle, as if in {unit}'


def _size_text(sensor: str, size: float) -> str:
    low, high = NORM_RANGES[sensor]
    unit = unit_of_norm(sensor, size)
    guess = f', as if in {unit}' if unit else '; are these counts, or is an axis dead?'
    return (
        f'{SENSOR_FIELDS[sensor]}: the median norm is {size:.4g} {SENSOR_UNITS[sensor]}, '
        f'expected {low:g} … {high:g}{guess}'
    )


def _foreign_temperature(recording: ImuRecording) -> str:
    """Return what is wrong where the die is in °F and its chamber in °C, or the reverse."""
    for field in (*THERMOMETER_FIELDS, 'setpoint'):
        chamber = getattr(recording, field)
        if chamber is None:
            continue
        known = np.isfinite(chamber) & np.isfinite(recording.temperature)
        if np.count_nonzero(known) < 3:
            continue
        x, y = chamber[known], recording.temperature[known]
        if _in_fahrenheit(y, x, still=True):
            text = f'temperature is {y.mean():.1f} on average where {field} is {x.mean():.1f} °C'
        elif _in_fahrenheit(x, y, still=False):
            text = f'{field} is {x.mean():.1f} on average where the die is {y.mean():.1f} °C'
        else:
            return ''
        return f'{text}, as if in °F'
    return _alone_in_fahrenheit(recording.temperature)


def _alone_in_fahrenheit(temperature: FloatArray) -> str:
    """Return what is wrong with a die temperature in °F that no other thermometer confirms."""
    known = temperature[np.isfinite(temperature)]
    if not len(known):
        return ''
    step = _count(known[:100_000])
    if step and _is_round(step / 1.8) and not _is_round(step):
        place = (known[:100_000] - 32.0) / step
        if np.abs(place - np.round(place)).max() < 10.0 * ROUND_STEP_TOLERANCE:
            return f'temperature has steps of {step:.6g}, {step / 1.8:.6g} °C, as if in °F'
    low, high = float(known.min()), float(known.max())
    hot = np.count_nonzero(known > HOTTEST_RATED_C) > DAMAGED_SHARE * len(known)
    if hot and low > COLDEST_F:
        return (
            f'temperature is {low:.1f} … {high:.1f} °C, sensors are made for {HOTTEST_RATED_C:g} '
            'at most: as if in °F'
        )
    return ''


def _is_round(step: float) -> bool:
    """Tell whether a thermometer's step is a power of two, or 1, 2 or 5 times one of ten.

    >>> _is_round(0.0625), _is_round(0.02), _is_round(0.1125)
    (True, True, False)
    """
    mantissas = np.array([1.0, 2.0, 5.0, 10.0]) * 10.0 ** np.floor(np.log10(step))
    nearest = np.append(mantissas, 2.0 ** np.round(np.log2(step)))
    return bool((np.abs(nearest / step - 1.0) < ROUND_STEP_TOLERANCE).any())


def _hot_throughout(recording: ImuRecording) -> str:
    """Return a hint where a die is throughout as warm as a room in °F."""
    known = recording.temperature[np.isfinite(recording.temperature)]
    if recording.chamber_temperature is not None or not len(known):
        return ''
    low, high = float(known.min()), float(known.max())
    if not (ROOM_RANGE_F[0] < low and high < ROOM_RANGE_F[1]):
        return ''
    return (
        f'temperature is {low:.1f} … {high:.1f} °C, never that of a room: where it is in °F, '
        'say so in the mapping'
    )


def _in_fahrenheit(y: FloatArray, x: FloatArray, *, still: bool) -> bool:
    """Tell whether y is in °F beside x in °C; `still`, where x hardly changes, too."""
    near = abs(float(np.mean((y - 32.0) / 1.8) - np.mean(x))) < CELSIUS_DISTANCE_K
    if not near or float(np.mean(y) - np.mean(x)) <= FAHRENHEIT_EXCESS_K:
        return False
    if np.ptp(x) < LEAST_CHAMBER_SPAN_K:
        return still
    return float(np.polyfit(x - x.mean(), y, 1)[0]) >= FAHRENHEIT_SLOPE_RATIO


def _rests(recording: ImuRecording) -> bool:
    """Tell whether gravity and field keep their direction: means over a hundredth of the rows."""
    if len(recording) < 100:
        return False
    edges = np.linspace(0, len(recording), 101).astype(int)[:-1]
    for field, change in REST_TURN_RAD.items():
        values = getattr(recording, field)
        known = np.isfinite(values).all(axis=1)
        if not known.any():
            if field == 'linear_acceleration':
                return False
            continue
        kept = np.where(known[:, None], values, 0.0)
        part = np.add.reduceat(known, edges, dtype=np.int64) > 0
        total = np.add.reduceat(kept, edges, axis=0)[part]
        norm = _norms(total)
        if not (norm > STILL_NORM_SHARE * np.add.reduceat(_norms(kept), edges)[part]).all():
            return False
        direction = total / norm[:, None]
        away = np.linalg.norm(direction - _median(direction), axis=1)
        if np.quantile(away, 0.95) > change:
            return False
    return True


def _median_norm(values: FloatArray) -> float:
    """Return the median of the norms of (n, 3) over at most about 100 000 rows; NaN for none."""
    some = values[:: max(len(values) // 100_000, 1)]
    some = some[np.isfinite(some).all(axis=1)]
    return float(np.median(_norms(some))) if len(some) else float('nan')


def _norms(values: FloatArray) -> FloatArray:
    with np.errstate(over='ignore'):
        norms: FloatArray = np.sqrt(np.einsum('ij,ij->i', values, values))
    return norms


def _median(values: FloatArray) -> FloatArray:
    some = values[:: max(len(values) // 100_000, 1)]
    some = some[np.isfinite(some).all(axis=1)]
    middle: FloatArray = np.median(some, axis=0) if len(some) else np.zeros(3)
    return middle


def _step(values: FloatArray) -> float:
    """Return the median step from row to row over the axes."""
    step = np.abs(np.diff(values[:100_000], axis=0))
    step = step[np.isfinite(step).all(axis=1)]
    return float(np.median(step.max(axis=1))) if len(step) else 0.0


def _unpredicted_step(values: FloatArray) -> float:
    """Return the median step of rows (n, 3) that the rows before them do not predict.

    A spectral line makes large steps, too, but earlier rows predict them, unlike white noise.
    Greatest of the axes: √2 of what the best linear prediction leaves, as a step of noise has.
    """
    windows = sliding_window_view(values[:100_000], PREDICTING_ROWS + 1, axis=0)
    largest = 0.0
    for axis in np.moveaxis(windows, 1, 0):
        known = axis[np.isfinite(axis).all(axis=1)]
        if len(known) > 2 * PREDICTING_ROWS:
            known = known - known.mean()
            weights = np.linalg.lstsq(known[:, :-1], known[:, -1], rcond=None)[0]
            left = known[:, -1] - known[:, :-1] @ weights
            largest = max(largest, float(np.median(np.abs(left))) * 2.0**0.5)
    return largest or _step(values)


def _count(column: FloatArray) -> float:
    """Return the size of one count of an axis (n,); 0 where its values are no counts.

    Most values of counts occur again, which averages and floating-point numbers do not.
    """
    known = column[np.isfinite(column)]
    numbers = np.unique(known)
    if not LEAST_DISTINCT_VALUES <= len(numbers) <= len(known) / 2:
        return 0.0
    return float(np.diff(numbers).min())


def _name(recording: ImuRecording) -> str:
    return recording.source or recording.run or 'recording'
