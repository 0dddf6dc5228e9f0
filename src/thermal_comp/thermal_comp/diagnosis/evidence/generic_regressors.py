# SPDX-License-Identifier: Apache-2.0
"""Flexible functions of one variable each: on which one does a residual depend?"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import TypeAlias

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from scipy.interpolate import BSpline

from thermal_comp.data.acting_channels import (
    ACTING_CHANNELS,
    MACHINES,
    THERMAL_CHANNELS,
    acting_on,
    channel_label,
)
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import SpectralLine, frequencies_told_apart
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.operators import follow, play, time_integral
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup

BAND_PIECES = 24
"""Pieces of a run over which a line's amplitude and phase are free."""
ROOM_C = 22.0
"""Temperature of the room a chamber stands in [°C]."""
TURN_K = 0.5
"""Half-width of the play that tells a turn of the temperature from its noise [K]."""
LAGS_S = (300.0, 1200.0)
"""Time constants with which an effect may follow a channel [s]."""
SETTLING_S = (60.0, 200.0)
"""Time constants with which an effect may settle after a channel has switched [s]."""


CHANNEL_CURVES = ', its lags and products'
CHAMBER_SETTLING_S = (300.0, 1500.0, 6000.0)
"""Time constants of a chamber whose machines are off [s]."""


Function: TypeAlias = tuple[str, str, Callable[[PreparedRun], FloatArray], bool]
"""What it depends on, its name, its columns (m, p) of a run; True: with coefficients of each."""


@dataclass(frozen=True)
class GenericRegressor:
    """A flexible function of one variable, as columns of a design."""

    depends_on: str
    name: str
    term: ColumnGroup
    unlogged: str = ''
    """Unlogged channel that would cause such a dependence; '' for a law of what was logged."""
    suspect: str = ''
    """Lost channel that may have the same course by chance; '' for none."""
    places: float = 1.0
    """Number of bands of frequency from which its band was chosen as the strongest; else 1."""

    @property
    def may_be_law(self) -> bool:
        """Whether it may be a law of logged variables; one of history repeats with the cycle."""
        return not self.unlogged or self.depends_on == 'phase'


def generic_regressors(
    design: CandidateDesign, catalogue: Mapping[str, type[Effect]]
) -> list[GenericRegressor]:
    """Return the generic regressors of the variables that were logged."""
    runs = design.source.smoothed
    spans = _spans(runs)
    made: list[Function] = [
        ('temperature', 'curve over temperature', spans.temperature, False),
        ('temperature', 'powers of temperature', spans.powers, False),
        ('branch', 'curve over temperature, one per branch', spans.branch, False),
        ('branch', 'fine curve over temperature, one per branch', spans.fine_branch, False),
        ('rate', 'curve over the temperature rate', spans.rate, False),
        ('rate', 'temperature rate and its square', spans.rate_slope, False),
        ('rate', 'temperature rate times temperature and time', spans.rate_products, False),
        ('time', 'curve over time', spans.time, False),
        ('time', 'wave over time', spans.wave, False),
        ('time', 'curve over time, one per run', spans.time, True),
        ('time', 'wave over time, one per run', spans.slow_wave, True),
        ('temperature', 'fine curve over temperature', spans.fine_temperature, False),
        ('time', 'curve over temperature that changes with time', spans.slope_in_time, False),
        ('orientation', 'powers of temperature, one set per orientation', spans.powers, True),
        ('orientation', RATE_PER_ORIENTATION, spans.rate_slope, True),
    ]
    if all(run.has_cycles for run in runs):
        made.append(('phase', 'curve over the phase of the cycle', spans.phase, False))
        if design.sensor == 'magnetometer' and len(runs) > 1:
            made.append(('phase', 'curve over the phase, one per run', spans.slow_phase, True))
        made.append(('cycle', 'level and slope of each cycle', spans.cycle, False))
    if any(run.conditions.time_before > 0.0 for run in runs):
        # Each pose is recorded at a time of its own: what changes looks like what is turned.
        ages = spans.slope_over_campaign
        made.append(('time', 'slope that changes over the campaign', ages, False))
    made += _functions_of_channels(design, catalogue, spans)
    for line in design.source.spectral_lines(design.sensor)[:1]:
        band = partial(spans.narrow_band, line)
        made.append(('frequency', 'line whose amplitude and phase wander', band, True))
    lost = lost_channels(design, catalogue)
    # The field of a machine stands still in the chamber: each orientation sees it turned.
    turned = design.sensor == 'magnetometer' and len(runs) > 1
    chamber = any(
        run.conditions.setpoint is not None or run.conditions.chamber_temperature is not None
        for run in runs
    )
    if set(MACHINES) & set(lost) and (turned or chamber):
        for course, settling in product(_courses_of_power(design), CHAMBER_SETTLING_S):
            trace = partial(spans.chamber_power, course, settling)
            made.append(('chamber', 'heat and cold the chamber needs', trace, turned))
    functions = [(function, per_run) for _, _, function, per_run in made]
    terms = design.generic_terms(functions, runs=runs)
    found = [
        _regressor(design, depends_on, name, term, lost)
        for (depends_on, name, _, _), term in zip(made, terms, strict=True)
    ]
    bands = max(frequencies_told_apart(design.source.runs) / BAND_PIECES, 1.0)
    return [replace(r, places=bands) if r.depends_on == 'frequency' else r for r in found]


def _functions_of_channels(
    design: CandidateDesign, catalogue: Mapping[str, type[Effect]], spans: _Spans
) -> list[Function]:
    """Return the functions of channels that all runs logged.

    What is proportional to a channel has a name; of those no effect acts through it is tried, too.
    """
    named = {c for e in catalogue.values() if design.sensor in e.sensors for c in e.channels}
    made: list[Function] = []
    for channel in ACTING_CHANNELS:
        label = channel.label
        if not all(run.conditions.has(channel.field) for run in design.source.smoothed):
            continue
        if channel.field == 'vibration':
            made.append((label, 'vibration and its square', spans.vibration, False))
            continue
        curve = partial(spans.channel, channel.field)
        made.append((label, f'{label}{CHANNEL_CURVES}', curve, False))
        if channel.field not in named:
            powers = partial(spans.channel_powers, channel.field)
            made.append((label, f'{label} and its square', powers, False))
    return made


def _courses_of_power(design: CandidateDesign) -> list[str]:
    """Return the temperatures that tell what a chamber needs: the die's and, nearer, the air's.

    Where the field of its machines is not measured only the die's: what follows the air faster
    than the die does may be an error of the thermometer as well.
    """
    air = [
        name
        for name in ('chamber_temperature', 'setpoint')
        if all(getattr(run.conditions, name) is not None for run in design.source.runs)
    ]
    return ['temperature', *(air[:1] if design.sensor == 'magnetometer' else [])]


def _regressor(
    design: CandidateDesign, depends_on: str, name: str, term: ColumnGroup, lost: Sequence[str]
) -> GenericRegressor:
    """Return a regressor with the lost channel that would cause it, or may look like it."""
    betrayed = _channel_behind(design, depends_on, lost)
    suspect = '' if betrayed else _possible_channel(design, depends_on, lost)
    return GenericRegressor(depends_on, name, term, betrayed, suspect)


RATE_PER_ORIENTATION = 'temperature rate, one slope per orientation'
"""Regressor that follows errors of a thermometer where the slope over temperature, by which they
act, is another by some per cent in an orientation."""
SMOOTH_CURVES = (
    'curve over temperature',
    'curve over temperature, one per branch',
    'curve over the temperature rate',
    'temperature rate times temperature and time',
    'curve over time',
    'curve over temperature that changes with time',
)
"""Regressors that together follow any smooth function of temperature, rate and time."""


def all_variables(design: CandidateDesign, regressors: Sequence[GenericRegressor]) -> ColumnGroup:
    """Return a smooth function of temperature and branch, rate, time and the logged channels."""
    parts = [r for r in regressors if r.name in SMOOTH_CURVES or r.name.endswith(CHANNEL_CURVES)]
    together = ColumnGroup(tuple(c for part in parts for c in part.term.columns))
    design.equations(together.columns)  # the products of one part with another, too
    return together


def lost_channels(design: CandidateDesign, catalogue: Mapping[str, type[Effect]]) -> list[str]:
    """Return the channels through which an effect can act on the sensor and that no run logged."""
    runs = design.source.runs
    return [
        channel.field
        for channel in acting_on(design.sensor, catalogue)
        if not any(run.conditions.has(channel.field) for run in runs)
    ]


def lost_over_time(design: CandidateDesign, catalogue: Mapping[str, type[Effect]]) -> str:
    """Return the lost channel that may have any course over time, '' for none."""
    return _possible_channel(design, 'time', lost_channels(design, catalogue))


def _possible_channel(design: CandidateDesign, depends_on: str, lost: Sequence[str]) -> str:
    """Return a lost channel that may have the course of a dependence by chance, '' for none.

    What is switched may have any course over time; the air leads the die in every ramp. One
    controller switches the machines of a chamber: the course of one tells that of the other.
    Their relays and motors make lines.
    """
    machines = [c for c in lost if c in MACHINES]
    if depends_on in {'rate', 'branch'}:
        air = any(
            run.conditions.has(name) for run in design.source.runs for name in THERMAL_CHANNELS
        )
        candidates: Sequence[str] = machines if air else ['chamber_temperature']
    elif depends_on in {'frequency', *map(channel_label, MACHINES)}:
        candidates = machines
    else:
        candidates = lost if depends_on in {'time', 'phase', 'cycle'} else []
    if len(machines) == len(MACHINES) and set(machines) <= set(candidates):
        return 'chamber'
    return channel_label(candidates[0]) if candidates else ''


def _channel_behind(design: CandidateDesign, depends_on: str, lost: Sequence[str]) -> str:
    """Return the lost channel through which a dependence would arise, '' for none.

    A compressor reaches accelerometer and gyroscope by shaking them or through the supply, a
    heater through the supply. What repeats with the cycle and is no law of temperature, or
    follows the chamber's power, is a machine of the chamber. The field of a machine turns with
    the orientation; an error of the magnetometer that does not turn comes from the supply.
    """
    through = {channel.label: channel.through for channel in ACTING_CHANNELS}
    through['phase'] = (*MACHINES, 'supply_voltage')
    through['chamber'] = (*MACHINES, 'supply_voltage', 'vibration')
    if design.sensor == 'magnetometer':
        turned = len(design.source.runs) > 1
        through |= dict.fromkeys(MACHINES, ('supply_voltage',) if turned else ())
        through['vibration'] = ('compressor',)
    suspects = [c for c in through.get(depends_on, ()) if c in lost]
    if set(MACHINES) <= set(suspects):
        return 'chamber'
    return channel_label(suspects[0]) if suspects else ''


@dataclass(frozen=True)
class _Spans:
    """Ranges shared by all runs, so that one curve fits them together."""

    low: float
    high: float
    fastest: float
    longest: float
    latest: float
    """Time from the first run to the last one [s]."""
    cycle_length: float
    cycles: IntArray
    """Numbers of the cycles that any run has."""

    def temperature(self, run: PreparedRun) -> FloatArray:
        return spline(run.temperature, self.low, self.high, 16)

    def fine_temperature(self, run: PreparedRun) -> FloatArray:
        return spline(run.temperature, self.low, self.high, 48)

    def branch(self, run: PreparedRun) -> FloatArray:
        curve = spline(run.temperature, self.low, self.high, 8)
        rising = self._rate(run) / self.fastest
        ways = [np.tanh(rising / 0.2), np.tanh(rising / 0.05), _last_way(run.temperature)]
        return np.concatenate([curve, *(curve * way[:, None] for way in ways)], axis=1)

    def fine_branch(self, run: PreparedRun) -> FloatArray:
        curve = spline(run.temperature, self.low, self.high, 24)
        return np.concatenate([curve, curve * _last_way(run.temperature)[:, None]], axis=1)

    def rate(self, run: PreparedRun) -> FloatArray:
        return spline(self._rate(run), -self.fastest, self.fastest, 9)

    def rate_products(self, run: PreparedRun) -> FloatArray:
        rate, x = self._rate(run) / self.fastest, self._temperature(run)
        t = run.time / self.longest
        products = [rate, rate * x, rate * x**2, rate**2 * x, rate * t, rate**2, rate**2 * t]
        return np.stack(products, axis=1)

    def rate_slope(self, run: PreparedRun) -> FloatArray:
        rate = self._rate(run) / self.fastest
        return np.stack([rate, rate**2], axis=1)

    def time(self, run: PreparedRun) -> FloatArray:
        return spline(run.time, 0.0, self.longest, 9)

    def wave(self, run: PreparedRun) -> FloatArray:
        return spline(run.time, 0.0, self.longest, 40)

    def slow_wave(self, run: PreparedRun) -> FloatArray:
        return spline(run.time, 0.0, self.longest, 24)

    def slope_in_time(self, run: PreparedRun) -> FloatArray:
        x = self._temperature(run)[:, None]
        share = run.time[:, None] / self.longest
        curve = spline(run.time, 0.0, self.longest, 4)
        return np.concatenate([curve * x, share * x**2, share**2 * x**2, x**2], axis=1)

    def slope_over_campaign(self, run: PreparedRun) -> FloatArray:
        x, age = self._temperature(run), run.time + run.conditions.time_before
        share = age / (self.longest + self.latest)
        return np.stack([share * x, share**2 * x, share * x**2], axis=1)

    def narrow_band(self, line: SpectralLine, run: PreparedRun) -> FloatArray:
        fine = run.conditions
        slow = spline(fine.time, 0.0, self.longest, BAND_PIECES)
        integral = time_integral(fine.time, fine.temperature_difference)[0]
        turn = 2.0 * np.pi * (line.frequency * fine.time + line.drift * integral)[:, None]
        return run.block_mean(np.concatenate([slow * np.cos(turn), slow * np.sin(turn)], axis=1))

    def powers(self, run: PreparedRun) -> FloatArray:
        fine = run.conditions
        x = (fine.temperature - fine.reference_temperature) / 30.0
        # As the catalogue's effects are: then what they explain costs nothing here.
        return run.block_mean(np.stack([x, x**2, x**3, x**4, np.abs(x)], axis=1))

    def phase(self, run: PreparedRun) -> FloatArray:
        return self._over_phase(run, 50)

    def slow_phase(self, run: PreparedRun) -> FloatArray:
        return self._over_phase(run, 30)

    def _over_phase(self, run: PreparedRun, pieces: int) -> FloatArray:
        since = _time_in_cycle(run)
        inside = (since >= 0.0) & (since <= self.cycle_length)
        curve = spline(np.clip(since, 0.0, self.cycle_length), 0.0, self.cycle_length, pieces)
        return curve * inside[:, None]

    def cycle(self, run: PreparedRun) -> FloatArray:
        member = (run.cycle[:, None] == self.cycles).astype(float)
        return np.concatenate([member, member * self._temperature(run)[:, None]], axis=1)

    def channel(self, name: str, run: PreparedRun) -> FloatArray:
        values = np.asarray(getattr(run.block_conditions, name))
        v, x, t = values - values.mean(), self._temperature(run), run.time / self.longest
        rate = self._rate(run) / self.fastest
        lags = [_lagged(run, v, lag) for lag in LAGS_S]
        turns = np.diff(v, prepend=v[0])
        starts, stops = np.maximum(turns, 0.0), np.minimum(turns, 0.0)
        after = [_lagged(run, way, lag) for way in (starts, stops) for lag in SETTLING_S]
        return np.stack([v, v * x, v * x**2, v**2, v * t, v * rate, *lags, *after], axis=1)

    def channel_powers(self, name: str, run: PreparedRun) -> FloatArray:
        values = np.asarray(getattr(run.block_conditions, name))
        v = values - values.mean()
        return np.stack([v, v**2], axis=1)

    def chamber_power(self, course: str, settling: float, run: PreparedRun) -> FloatArray:
        """(m, 2) power a chamber needs to heat and to cool: P = τ dT/dt + T − T_room."""
        temperature = np.asarray(getattr(run.block_conditions, course))
        power = settling * np.gradient(temperature, run.time) + temperature - ROOM_C
        return np.stack([np.maximum(power, 0.0), np.minimum(power, 0.0)], axis=1)

    def vibration(self, run: PreparedRun) -> FloatArray:
        values = np.asarray(run.block_conditions.vibration)
        return np.concatenate([values, values**2], axis=1)

    @staticmethod
    def _temperature(run: PreparedRun) -> FloatArray:
        return (run.temperature - run.conditions.reference_temperature) / 30.0

    @staticmethod
    def _rate(run: PreparedRun) -> FloatArray:
        return np.asarray(np.gradient(run.temperature, run.time))


def _spans(runs: Sequence[PreparedRun]) -> _Spans:
    lengths = [_cycle_length(run) for run in runs if run.has_cycles]
    rates = [np.abs(_Spans._rate(run)).max() for run in runs]
    return _Spans(
        low=min(float(run.temperature.min()) for run in runs),
        high=max(float(run.temperature.max()) for run in runs),
        fastest=max(float(max(rates)), 1e-6),
        longest=max(float(run.time[-1]) for run in runs),
        latest=max(run.conditions.time_before for run in runs),
        cycle_length=max(lengths, default=1.0),
        cycles=np.unique(np.concatenate([run.cycle[run.cycle > 0] for run in runs])),
    )


def _lagged(run: PreparedRun, values: FloatArray, time_constant: float) -> FloatArray:
    return follow(run.time, values, time_constant)[0]


def _last_way(temperature: FloatArray) -> FloatArray:
    """(m,) +1 where the temperature rose last, −1 where it fell, through dwells as well."""
    moved = np.sign(np.diff(play(temperature, TURN_K)[0], prepend=np.nan))
    known = np.isfinite(moved) & (moved != 0.0)
    newest = np.maximum.accumulate(np.where(known, np.arange(len(moved)), 0))
    return np.where(known[newest], moved[newest], 0.0)


def _time_in_cycle(run: PreparedRun) -> FloatArray:
    """(m,) time since the cycle began [s]; negative outside the cycles."""
    since = np.full(len(run), -1.0)
    for number in np.unique(run.cycle[run.cycle > 0]):
        inside = run.cycle == number
        since[inside] = run.time[inside] - run.time[inside][0]
    return since


def _cycle_length(run: PreparedRun) -> float:
    return float(max(_time_in_cycle(run).max(), 1.0))


def spline(values: FloatArray, low: float, high: float, pieces: int) -> FloatArray:
    """(m, pieces + 2) quadratic B-splines between low and high."""
    if not high > low:
        return np.ones((len(values), 1))
    knots = np.concatenate([[low] * 2, np.linspace(low, high, pieces + 1), [high] * 2])
    clipped = np.clip(values, low, high)
    return np.asarray(BSpline.design_matrix(clipped, knots, 2).toarray())
