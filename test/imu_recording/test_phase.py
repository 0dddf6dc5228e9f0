# SPDX-License-Identifier: Apache-2.0
"""Phases follow from the set-point alone, however it is logged."""

from __future__ import annotations

import doctest
from itertools import pairwise

import numpy as np
import pytest
from imu_recording.phase import cycles_from_temperature, phases_from_setpoint
from imu_recording.recording import PHASES

from imu_recording import RecordingError
from imu_recording import phase as phase_module

CYCLE = [(-10, 'ramp_down'), (50, 'ramp_up'), (20, 'ramp_down')]


def plan(
    *, cycles: int = 4, start: float = 20, rate: float = 2, dwell: float = 30, final: float = 30
) -> tuple[np.ndarray, np.ndarray, list[tuple[float, str, int]]]:
    """Knots of the paper's profile (minutes, °C) and the phases it is made of."""
    knots = [(0.0, start)]
    phases = [(0.0, 'precondition', 0)]

    def move(to: float) -> None:
        knots.append((knots[-1][0] + abs(to - knots[-1][1]) / rate, to))

    def stay(minutes: float) -> None:
        knots.append((knots[-1][0] + minutes, knots[-1][1]))

    if start != 20.0:
        stay(5.0)
        move(20.0)
    stay(60.0)
    names = {-10: 'dwell_cold', 50: 'dwell_hot', 20: 'dwell_reference'}
    for cycle in range(1, cycles + 1):
        for level, ramp in CYCLE:
            phases.append((knots[-1][0], ramp, cycle))
            move(level)
            phases.append((knots[-1][0], names[level], cycle))
            stay(dwell)
    if final:
        phases.append((knots[-1][0], 'final', 0))
        stay(final)
    times, levels = np.array(knots).T
    return times * 60, levels, phases


def assert_phases(
    time: np.ndarray, setpoint: np.ndarray, wanted: list[tuple[float, str, int]], slack: float
) -> None:
    phase, cycle = phases_from_setpoint(time, setpoint)
    ends = [begin for begin, _, _ in wanted[1:]] + [time[-1] / 60 + 1]
    for (begin, name, number), end in zip(wanted, ends, strict=True):
        inside = (time > begin * 60 + slack) & (time < end * 60 - slack)
        assert inside.any()
        assert {PHASES[p] for p in phase[inside]} == {name}, (name, number)
        assert set(cycle[inside].tolist()) == {number}, (name, number)


@pytest.mark.parametrize('start', [20.0, 23.0, 18.5])
@pytest.mark.parametrize(
    ('period', 'logged', 'resolution'), [(5, 5, 0), (2, 10, 0.1), (1, 30, 0.1)]
)
def test_the_papers_plan(start: float, period: int, logged: int, resolution: float) -> None:
    """Smooth, held for several rows, and rounded to the chamber's protocol."""
    times, levels, wanted = plan(start=start)
    time = np.arange(0, times[-1], period, dtype=float)
    setpoint = np.interp(time // logged * logged, times, levels)
    if resolution:
        setpoint = np.round(setpoint / resolution) * resolution
    assert_phases(time, setpoint, wanted, slack=2.0 * logged + 1)


@pytest.mark.parametrize('start', [20.0, 23.0, 18.5])
@pytest.mark.parametrize('cycles', [1, 2, 3])
def test_few_cycles_after_a_long_precondition(start: float, cycles: int) -> None:
    """The dwell after the approach to the reference is no reference dwell of a cycle."""
    times, levels, wanted = plan(start=start, cycles=cycles)
    time = np.arange(0, times[-1], 2.0)
    assert_phases(time, np.interp(time, times, levels), wanted, slack=3.0)


def test_cut_anywhere_the_beginning_is_the_same() -> None:
    times, levels, _ = plan()
    time = np.arange(0, times[-1], 5.0)
    setpoint = np.interp(time, times, levels)
    phase, cycle = phases_from_setpoint(time, setpoint)
    for share in (0.3, 0.5, 0.8):
        cut = int(share * len(time))
        part_phase, part_cycle = phases_from_setpoint(time[:cut], setpoint[:cut])
        settled = slice(0, cut - 2 * 3600 // 5)
        assert np.array_equal(part_phase[settled], phase[settled])
        assert np.array_equal(part_cycle[settled], cycle[settled])


def test_cut_within_any_ramp() -> None:
    """A recording that is stopped while the set-point moves has no dwell after the ramp."""
    times, levels, _ = plan(cycles=2)
    time = np.arange(0, times[-1], 5.0)
    setpoint = np.interp(time, times, levels)
    phase, _ = phases_from_setpoint(time, setpoint)
    ramps = np.isin(phase, [PHASES.index('ramp_up'), PHASES.index('ramp_down')])
    for cut in range(800, len(time), 37):
        if ramps[cut - 40 : cut].all():  # more than two kelvin
            part, _ = phases_from_setpoint(time[:cut], setpoint[:cut])
            assert part[-1] == phase[cut - 1]


def test_ramps_that_turn_without_a_dwell() -> None:
    time = np.arange(0.0, 7200.0, 10.0)
    for first in (600.0, 0.0):
        knots = [0.0, first, first + 1800.0, first + 5400.0]
        setpoint = np.interp(time, knots, [20.0, 20.0, 60.0, -20.0])
        phase, cycle = phases_from_setpoint(time, setpoint)
        assert PHASES[phase[np.searchsorted(time, first + 900.0)]] == 'ramp_up'
        assert PHASES[phase[np.searchsorted(time, first + 3000.0)]] == 'ramp_down'
        assert cycle[-1] == 1


def test_steps_without_ramps_and_without_return_to_the_reference() -> None:
    """Two-zone cycling: hot, cold, hot …; every return to cold is a new cycle."""
    levels = [20.0, -40.0, 125.0, -40.0, 125.0, -40.0, 125.0]
    time = np.arange(0.0, 900.0 * len(levels), 10.0)
    setpoint = np.repeat(levels, 90)
    phase, cycle = phases_from_setpoint(time, setpoint)
    found = [(PHASES[phase[i * 90 + 45]], int(cycle[i * 90 + 45])) for i in range(len(levels))]
    assert found == [
        ('precondition', 0),
        ('dwell_cold', 1),
        ('dwell_hot', 1),
        ('dwell_cold', 2),
        ('dwell_hot', 2),
        ('dwell_cold', 3),
        ('dwell_hot', 3),
    ]


def test_constant_or_unknown_setpoint() -> None:
    time = np.arange(100.0)
    phase, cycle = phases_from_setpoint(time, np.full(100, 20.0))
    assert set(phase.tolist()) == {0}
    assert not cycle.any()
    setpoint = np.full(100, 20.0)
    setpoint[:10] = np.nan
    phase, _ = phases_from_setpoint(time, setpoint)
    assert phase[:10].tolist() == [-1] * 10
    phase, _ = phases_from_setpoint(time, np.full(100, np.nan))
    assert set(phase.tolist()) == {-1}
    assert phases_from_setpoint(np.empty(0), np.empty(0))[0].shape == (0,)


def test_phases_follow_each_other() -> None:
    times, levels, wanted = plan(final=0.0)
    time = np.arange(0, times[-1], 5.0)
    phase, _ = phases_from_setpoint(time, np.interp(time, times, levels))
    order = [int(phase[0])] + [int(b) for a, b in pairwise(phase) if a != b]
    assert [PHASES[p] for p in order] == [name for _, name, _ in wanted]


def test_text_of_a_phase() -> None:
    assert doctest.testmod(phase_module).failed == 0
    with pytest.raises(RecordingError, match='phase 9 is no index'):
        phase_module.format_phase(9, 1)


@pytest.mark.parametrize('cycles', [2, 3, 5])
def test_cycles_are_found_in_the_temperature_itself(cycles: int) -> None:
    hour = 3600.0
    time = np.arange(0.0, (cycles + 1) * hour, 5.0)
    inside = (time >= 0.5 * hour) & (time < (cycles + 0.5) * hour)
    part = np.where(inside, (time - 0.5 * hour) % hour / hour, 0.0)
    noise = np.random.default_rng(1).normal(0.0, 0.05, len(time))
    temperature = np.interp(part, [0.0, 0.2, 0.3, 0.6, 0.7, 0.9], [20, -10, -10, 50, 50, 20])
    found = cycles_from_temperature(time, temperature + noise)
    assert found.max() == cycles
    for number in range(1, cycles + 1):
        start = 0.5 * hour + (number - 1) * hour
        assert found[np.searchsorted(time, start + 0.3 * hour)] == number
        assert found[np.searchsorted(time, start + 0.6 * hour)] == number
    assert not cycles_from_temperature(time, temperature * np.exp(-time / hour)).any()
    assert not cycles_from_temperature(time, np.full(len(time), 21.5)).any()
    assert not cycles_from_temperature(time, np.full(len(time), np.nan)).any()
