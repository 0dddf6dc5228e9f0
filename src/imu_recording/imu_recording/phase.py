# SPDX-License-Identifier: Apache-2.0
"""Phases of the thermal cycle: their text on a topic, and how they follow from the set-point.

Where neither was logged, cycles that repeat are found in the temperature itself.
"""

from __future__ import annotations

import numpy as np

from imu_recording.recording import PHASES, FloatArray, IntArray, RecordingError

UNKNOWN_PHASE = -1
RAMP_RATE_C_PER_MIN = 0.2
"""A set-point that moves faster is a ramp [°C/min]; IEC 60068-2-14 Nb ramps start at 1."""
SAME_LEVEL_C = 2.0
"""Dwells whose temperatures differ by less are at the same level [°C]."""
LEAST_SWING_C = 5.0
"""Least span of the temperature in which cycles are looked for [°C]."""
LEAST_SWING_SHARE = 0.6
"""Least way of the temperature from one turning point to the next, as a share of its span."""
LEAVING_SHARE = 0.1
"""The first cycle starts when the temperature has moved by this share of its span."""
LEVEL_TOLERANCE_SHARE = 0.2
"""Largest difference of turning points of one side where cycles repeat, as a share of the span."""
LENGTH_TOLERANCE_FACTOR = 1.35
"""Largest ratio of lengths of such cycles to their median."""
MOST_SEARCHED_ROWS = 20_000
"""Number of rows in which cycles are looked for, at most about."""


def parse_phase(text: str) -> tuple[int, int]:
    """Return index into PHASES (−1 unknown) and cycle of a phase message.

    >>> parse_phase('ramp_up 2')
    (3, 2)
    >>> parse_phase('final'), parse_phase('coffee 3')
    ((6, 0), (-1, 3))
    """
    name, _, number = text.strip().partition(' ')
    cycle = int(number) if number.strip().isdecimal() else 0
    return (PHASES.index(name) if name in PHASES else UNKNOWN_PHASE), cycle


def format_phase(phase: int, cycle: int) -> str:
    """Return the text of a phase message.

    >>> format_phase(3, 2)
    'ramp_up 2'
    """
    if not 0 <= phase < len(PHASES):
        raise RecordingError(f'phase {phase} is no index into {", ".join(PHASES)}')
    return f'{PHASES[phase]} {cycle}'


def phases_from_setpoint(time: FloatArray, setpoint: FloatArray) -> tuple[IntArray, IntArray]:
    """Return phase (index into PHASES) and cycle of every row from the set-point alone.

    `time` (n,) [s] increasing, `setpoint` (n,) [°C]. It moves in a ramp and stands in a dwell.
    The hot, cold and reference levels are those of the dwells; everything before the first ramp
    is preconditioning, a last dwell at the reference level is `final`; both have cycle 0. A cycle
    starts with the first ramp that leaves the level it started from. NaN rows are −1, 0.
    """
    phase = np.full(len(time), UNKNOWN_PHASE, dtype=np.int64)
    cycle = np.zeros(len(time), dtype=np.int64)
    valid = np.flatnonzero(np.isfinite(setpoint))
    if valid.size:
        phase[valid], cycle[valid] = _phases(time[valid], setpoint[valid])
    return phase, cycle


def cycles_from_temperature(time: FloatArray, temperature: FloatArray) -> IntArray:
    """Return the thermal cycle of every row, 1 …, from the temperature alone; 0 outside cycles.

    `time` (n,) [s] increasing, `temperature` (n,) [°C]. A cycle holds two turning points; it ends
    where the temperature passes the middle on its way to the next one. Zero throughout where not
    two cycles of like levels and lengths follow each other.
    """
    cycle = np.zeros(len(time), np.int64)
    known = np.flatnonzero(np.isfinite(temperature))
    known = known[:: len(known) // MOST_SEARCHED_ROWS + 1]
    values = temperature[known]
    span = float(np.ptp(values)) if len(values) else 0.0
    if span < LEAST_SWING_C:
        return cycle
    first = int(np.argmax(np.abs(values - values[0]) > LEAVING_SHARE * span))
    turns = [row for row in _turning_points(values, LEAST_SWING_SHARE * span) if row >= first]
    count = len(turns) // 2
    if count < 2:
        return cycle
    inner = [_passing(values, *turns[2 * k + 1 : 2 * k + 3]) for k in range(count - 1)]
    starts = time[known[[first, *inner]]]
    usual = float(np.median(np.diff(starts)))
    longest = LENGTH_TOLERANCE_FACTOR * usual
    stop = min(float(time[-1]), float(starts[-1]) + longest)
    lengths = np.diff(starts, append=stop)
    levels = values[turns[: 2 * count]]
    unlike = any(np.ptp(levels[side::2]) > LEVEL_TOLERANCE_SHARE * span for side in (0, 1))
    if unlike or lengths.min() * LENGTH_TOLERANCE_FACTOR < usual or lengths[:-1].max() > longest:
        return cycle
    inside = (time >= starts[0]) & (time < stop)
    cycle[inside] = np.searchsorted(starts, time[inside], side='right')
    return cycle


def _turning_points(values: FloatArray, least: float) -> list[int]:
    """Return the rows at which the temperature turns, each `least` [K] off the one before.

    The last extreme is one of them, as the way to it is as long.
    """
    low = high = 0
    turns: list[int] = []
    direction = 0
    for row, value in enumerate(values.tolist()):
        low = row if value < values[low] else low
        high = row if value > values[high] else high
        if direction >= 0 and values[high] - value > least:
            turns.append(high)
            direction, low = -1, row
        elif direction <= 0 and value - values[low] > least:
            turns.append(low)
            direction, high = 1, row
    return [*turns, high if direction > 0 else low] if turns else []


def _passing(values: FloatArray, before: int, after: int) -> int:
    """Return the median of the rows between two turning points that are near their mean value."""
    way = values[before : after + 1]
    off = np.abs(way - 0.5 * (way[0] + way[-1]))
    near = np.flatnonzero(off <= max(LEAVING_SHARE * abs(way[-1] - way[0]), float(off.min())))
    return before + int(np.median(near))


def _phases(time: FloatArray, setpoint: FloatArray) -> tuple[IntArray, IntArray]:
    moves = _moves(time, setpoint)
    n = len(time)
    phase = np.full(n, PHASES.index('precondition'), np.int64)
    cycle = np.zeros(n, np.int64)
    if not moves:
        return phase, cycle
    starts = [0] + [stop for _, stop in moves]
    stops = [start for start, _ in moves] + [n]
    # Where a ramp turns, or the recording ends in it, the dwell between has no row.
    firsts = [min(a, b - 1) for a, b in zip(starts, stops, strict=True)]
    levels = [float(np.median(setpoint[a:b])) for a, b in zip(firsts, stops, strict=True)]
    lengths = [float(time[b - 1] - time[a]) for a, b in zip(firsts, stops, strict=True)]
    reference = _reference_level(levels, lengths)
    kinds = [_dwell_kind(level, reference) for level in levels]
    number = 0
    seen: set[str] = set()
    for k, (start, stop) in enumerate(moves):
        before, after = kinds[k], kinds[k + 1]
        leaves = before == 'dwell_reference' and (number or after != before)
        if leaves or (after in seen and after != 'dwell_reference'):
            number, seen = number + 1, set()
        if not number and after == 'dwell_reference':
            continue  # still on the way to the reference level
        number = max(number, 1)
        seen.add(after)
        ramp = 'ramp_up' if setpoint[stop - 1] > setpoint[max(start - 1, 0)] else 'ramp_down'
        phase[start:stop] = PHASES.index(ramp)
        phase[stop : stops[k + 1]] = PHASES.index(after)
        cycle[start : stops[k + 1]] = number
    if kinds[-1] == 'dwell_reference' and starts[-1] < n and cycle[-1]:
        dwells = zip(starts[:-1], lengths[:-1], kinds[:-1], strict=True)
        earlier = [(length, kind) for a, length, kind in dwells if cycle[a]]
        references = [length for length, kind in earlier if kind == 'dwell_reference']
        every = [length for length, _ in earlier]
        _split_final(phase, cycle, time, starts[-1], references or every)
    return phase, cycle


def _moves(time: FloatArray, setpoint: FloatArray) -> list[tuple[int, int]]:
    """Return (first row that moved, first row that stands again) of every ramp and step."""
    step = np.diff(setpoint)
    changes = np.flatnonzero(np.abs(step) > 1e-6) + 1
    if not changes.size:
        return []
    gaps = np.diff(time[changes])
    sizes = step[changes - 1]
    same_way = np.sign(sizes[1:]) == np.sign(sizes[:-1])
    steady = same_way & (np.abs(sizes[1:]) / gaps * 60 >= RAMP_RATE_C_PER_MIN)
    if steady.any():
        steady &= gaps <= 4 * np.median(gaps[steady])
    firsts = changes[np.concatenate(([True], ~steady))]
    lasts = changes[np.concatenate((~steady, [True]))]
    moves: list[tuple[int, int]] = []
    for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True):
        if abs(setpoint[last] - setpoint[first - 1]) >= SAME_LEVEL_C:
            moves.append((first, last + 1 if last > first else first))
    return moves


def _reference_level(levels: list[float], lengths: list[float]) -> float:
    """Return the level between the extremes that the run starts from and comes back to.

    That is the first or second level (the first may be the room, before the approach to the
    reference); where neither recurs, the level between the extremes that was held longest.
    """
    low, high = min(levels) + SAME_LEVEL_C, max(levels) - SAME_LEVEL_C
    inner = [k for k, level in enumerate(levels) if low < level < high]
    if not inner:
        return levels[0]

    visits = {k: [i for i in inner if abs(levels[i] - levels[k]) <= SAME_LEVEL_C] for k in inner}
    for k in inner:
        if k < 2 and len(visits[k]) > 1:
            return levels[k]
    return levels[max(inner, key=lambda k: sum(lengths[i] for i in visits[k]))]


def _dwell_kind(level: float, reference: float) -> str:
    if abs(level - reference) <= SAME_LEVEL_C:
        return 'dwell_reference'
    return 'dwell_cold' if level < reference else 'dwell_hot'


def _split_final(
    phase: IntArray, cycle: IntArray, time: FloatArray, start: int, earlier: list[float]
) -> None:
    """Mark as final the time by which the last reference dwell exceeds the `earlier` ones [s]."""
    if not earlier:
        return
    usual = float(np.median(earlier))
    final = (time >= time[start] + 1.05 * usual) & (np.arange(len(time)) >= start)
    if not final.any():
        return
    final |= (time >= time[start] + usual) & (np.arange(len(time)) >= start)
    phase[final] = PHASES.index('final')
    cycle[final] = 0
