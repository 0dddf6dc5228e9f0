# SPDX-License-Identifier: Apache-2.0
"""Effects of the catalogue, and laws outside it, as functions of the surroundings.

A law draws its parameters once per campaign and then gives its signal for every run: (n,) or
(n, 3). Where the law couples the axes the signal is complete; elsewhere every axis multiplies it
by a coefficient of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from independent_simulator.surroundings import Array, Conditions, lag, play, switching

Parameters: TypeAlias = dict[str, Any]
Draw: TypeAlias = Callable[[np.random.Generator, Sequence[Conditions]], Parameters]
Signal: TypeAlias = Callable[[Conditions, str, Parameters], Array]

ACCELEROMETER, GYROSCOPE, MAGNETOMETER = 'accelerometer', 'gyroscope', 'magnetometer'
ALL = (ACCELEROMETER, GYROSCOPE, MAGNETOMETER)
REFERENCE = 20.0
"""Temperature from which x is counted [°C]."""


@dataclass(frozen=True)
class Law:
    sensors: tuple[str, ...]
    signal: Signal
    draw: Draw = lambda _rng, _runs: {}
    coupled: bool = False
    """The signal holds the axes' relative sizes."""
    joint: bool = False
    """Acts on all its sensors at once."""
    needs: tuple[str, ...] = ()
    """Tracks of which one must be logged for the law to be nameable."""


def _x(run: Conditions) -> Array:
    return run.die - REFERENCE


def _longest(runs: Sequence[Conditions]) -> float:
    return max(len(run.time) * run.dt for run in runs)


def _span(runs: Sequence[Conditions]) -> tuple[float, float]:
    return min(float(run.die.min()) for run in runs), max(float(run.die.max()) for run in runs)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(max(high, 1.01 * low)))))


def _matrix(rng: np.random.Generator, diagonal: bool = True) -> list[list[float]]:
    matrix = rng.normal(size=(3, 3))
    return (matrix if diagonal else matrix - np.diag(np.diag(matrix))).tolist()


def _input(run: Conditions, sensor: str) -> Array:
    return run.force if sensor == ACCELEROMETER else run.rotation @ run.field


# Effects of the catalogue ------------------------------------------------------------------------


def _curvature(run: Conditions, _sensor: str, p: Parameters) -> Array:
    x = _x(run) / 30.0
    return p['square'] * x**2 + p['cube'] * x**3


def _draw_curvature(rng: np.random.Generator, _runs: Sequence[Conditions]) -> Parameters:
    return {'square': 1.0, 'cube': float(rng.choice([0.0, rng.uniform(-0.6, 0.6)]))}


def _draw_lag(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    return {'time_constant': _log(rng, 20.0, min(1800.0, _longest(runs) / 4.0))}


def _thermal_lag(run: Conditions, _sensor: str, p: Parameters) -> Array:
    return lag(run.die, run.dt, p['time_constant']) - run.die


def _draw_two_stage(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    slow = _log(rng, 400.0, min(1800.0, _longest(runs) / 4.0))
    fast = _log(rng, 30.0, min(120.0, slow / 5.0))
    share = rng.uniform(0.3, 0.7)
    return {'time_constant_fast': fast, 'time_constant_slow': slow, 'fast_share': share}


def _two_stage(run: Conditions, _sensor: str, p: Parameters) -> Array:
    fast = lag(run.die, run.dt, p['time_constant_fast']) - run.die
    slow = lag(run.die, run.dt, p['time_constant_slow']) - run.die
    return p['fast_share'] * fast + (1.0 - p['fast_share']) * slow


def _draw_gradient(rng: np.random.Generator, _runs: Sequence[Conditions]) -> Parameters:
    return {'between': str(rng.choice(['air and die', 'air and die', 'board and die']))}


def _gradient(run: Conditions, _sensor: str, p: Parameters) -> Array:
    return (run.air if p['between'] == 'air and die' else run.board) - run.die


def _draw_hysteresis(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    low, high = _span(runs)
    widest = 0.4 * (high - low)
    count = int(rng.integers(1, 5))
    widths = np.sort(np.exp(rng.uniform(np.log(0.08 * widest), np.log(widest), count)))
    return {'half_widths': widths.tolist(), 'weights': rng.uniform(0.3, 1.0, count).tolist()}


def _hysteresis(run: Conditions, _sensor: str, p: Parameters) -> Array:
    step = max(1, int(5.0 / run.dt))
    coarse = run.die[::step]
    loops = [
        weight * (play(coarse, width) - coarse)
        for width, weight in zip(p['half_widths'], p['weights'], strict=True)
    ]
    return np.interp(np.arange(len(run.die)), np.arange(len(coarse)) * step, np.sum(loops, 0))


def _draw_warm_up(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    time_constant = _log(rng, 120.0, min(1500.0, _longest(runs) / 3.0))
    return {'time_constant': time_constant, 'slow_share': float(rng.choice([0.0, 0.0, 0.3]))}


def _warm_up(run: Conditions, _sensor: str, p: Parameters) -> Array:
    slow = np.exp(-run.power_on / (4.0 * p['time_constant']))
    return (1.0 - p['slow_share']) * np.exp(-run.power_on / p['time_constant']) + (
        p['slow_share'] * slow
    )


def _vibration_rectification(run: Conditions, sensor: str, _p: Parameters) -> Array:
    return run.vibration if sensor == ACCELEROMETER else run.vibration.sum(1)


def _draw_humidity(rng: np.random.Generator, _runs: Sequence[Conditions]) -> Parameters:
    form = str(rng.choice(['first order', 'first order', 'diffusion']))
    return {'time_constant': _log(rng, 600.0, 10_000.0), 'form': form}


def _moisture(run: Conditions, _sensor: str, p: Parameters) -> Array:
    if p['form'] == 'first order':
        return lag(run.humidity, run.dt, p['time_constant'])
    modes = [lag(run.humidity, run.dt, p['time_constant'] / k**2) / k**2 for k in (1, 3, 5, 7)]
    return np.sum(modes, 0)


def _draw_levels(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    most = max(int(run.cycle.max()) for run in runs) + 1
    return {'levels': {f'{run.time[0]:.0f}': rng.normal(size=(most, 3)).tolist() for run in runs}}


def _levels(run: Conditions, _sensor: str, p: Parameters) -> Array:
    # The last cycle's level holds to the end of the run, the first one's from its beginning.
    cycle = np.maximum.accumulate(np.maximum(run.cycle, 1))
    start = min(p['levels'], key=lambda key: abs(float(key) - run.time[0]))
    return np.array(p['levels'][start])[np.minimum(cycle, run.cycle.max())]


def _draw_step(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    run = runs[int(rng.integers(len(runs)))]
    return {'at': float(run.time[int(rng.uniform(0.12, 0.88) * len(run.time))])}


def _step(run: Conditions, _sensor: str, p: Parameters) -> Array:
    return (run.time >= p['at']).astype(float)


def _drift(run: Conditions, _sensor: str, _p: Parameters) -> Array:
    return run.time / 3600.0


def _draw_creep(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    counted = str(rng.choice(['from the first run', 'from power-on']))
    return {'time_constant': _log(rng, 120.0, min(3600.0, _longest(runs) / 3.0)), 'time': counted}


def _creep(run: Conditions, _sensor: str, p: Parameters) -> Array:
    since = run.time if p['time'] == 'from the first run' else run.power_on
    return np.log1p(since / p['time_constant'])


def _draw_vector(rng: np.random.Generator, _runs: Sequence[Conditions]) -> Parameters:
    vector = rng.normal(size=3)
    return {'direction': (vector / np.linalg.norm(vector)).tolist()}


def _turned(run: Conditions, p: Parameters) -> Array:
    return run.rotation @ np.array(p['direction'])


def _tilt(run: Conditions, sensor: str, p: Parameters) -> Array:
    upright = np.array([0.0, 0.0, 9.80665]) if sensor == ACCELEROMETER else run.field
    return np.outer(_x(run), run.rotation @ np.cross(p['direction'], upright))


def _draw_alias(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
    """The beat of the mains with the device's samples: rows further apart show an alias of it."""
    frequency = rng.uniform(0.06, 0.42) / max(1.0, runs[0].dt)
    drift = float(rng.choice([0.0, rng.uniform(-2e-4, 2e-4) * frequency / 0.2]))
    gated = any(run.heater.max() > 0.0 for run in runs) and rng.random() < 0.4
    return {'beat': frequency, 'per_kelvin': drift, 'gated': bool(gated)}


def _alias(run: Conditions, _sensor: str, p: Parameters) -> Array:
    frequency = np.abs(p['beat'] + p['per_kelvin'] * _x(run))
    line = np.cos(2.0 * np.pi * np.cumsum(frequency) * run.dt + p['beat'] * run.time[0])
    return line * (run.heater if p['gated'] else 1.0)


def _draw_icing(rng: np.random.Generator, _runs: Sequence[Conditions]) -> Parameters:
    return {
        'growth': 1.0,
        'melt': _log(rng, 0.5, 6.0),
        'freezing': rng.uniform(-1.0, 0.5),
        'growth_law': str(rng.choice(['proportional', 'proportional', 'constant'])),
        'most': float(rng.choice([np.inf, _log(rng, 3.0, 12.0)])),
    }


def _icing(run: Conditions, _sensor: str, p: Parameters) -> Array:
    step = max(1, int(10.0 / run.dt))
    below = p['freezing'] - run.board[::step]
    growth = np.maximum(below, 0.0) if p['growth_law'] == 'proportional' else 5.0 * (below > 0.0)
    change = (growth - p['melt'] * np.maximum(-below, 0.0)) * step * run.dt / 3600.0
    ice, grown = 0.0, []
    for amount in change.tolist():
        ice = min(max(ice + amount, 0.0), p['most'])
        grown.append(ice)
    return np.interp(np.arange(len(run.die)), np.arange(len(grown)) * step, grown)


AIR = ('chamber_temperature', 'chamber_temperature_2', 'device_temperature')
CATALOGUE: Mapping[str, Law] = {
    'bias_temperature_curvature': Law(ALL, _curvature, _draw_curvature),
    'scale_factor_temperature': Law(
        (ACCELEROMETER, MAGNETOMETER), lambda run, s, _p: np.outer(_x(run), _input(run, s))
    ),
    'misalignment_temperature': Law(
        (ACCELEROMETER, MAGNETOMETER),
        lambda run, s, p: np.outer(_x(run), np.array(p['matrix']) @ _input(run, s)),
        lambda rng, _runs: {'matrix': _matrix(rng, diagonal=False)},
        coupled=True,
    ),
    'g_sensitivity_temperature': Law(
        (GYROSCOPE,),
        lambda run, _s, p: np.outer(_x(run), np.array(p['matrix']) @ run.force),
        lambda rng, _runs: {'matrix': _matrix(rng)},
        coupled=True,
    ),
    'thermal_lag': Law(ALL, _thermal_lag, _draw_lag),
    'thermal_lag_two_stage': Law(ALL, _two_stage, _draw_two_stage),
    'temperature_rate': Law(ALL, lambda run, _s, _p: run.rate * 60.0),
    'thermal_gradient': Law(ALL, _gradient, _draw_gradient, needs=AIR),
    'thermal_hysteresis': Law(ALL, _hysteresis, _draw_hysteresis),
    'warm_up': Law(ALL, _warm_up, _draw_warm_up),
    'supply_sensitivity': Law(
        ALL, lambda run, _s, _p: run.supply - 5.0, needs=('supply_voltage',)
    ),
    'vibration_rectification': Law(
        (ACCELEROMETER, GYROSCOPE), _vibration_rectification, needs=('vibration',)
    ),
    'humidity': Law(ALL, _moisture, _draw_humidity, needs=('humidity',)),
    'turn_on_bias': Law(ALL, _levels, _draw_levels, coupled=True, needs=('phase',)),
    'bias_step': Law(ALL, _step, _draw_step),
    'bias_drift': Law(ALL, _drift),
    'bias_creep': Law(ALL, _creep, _draw_creep),
    'heater_hard_iron': Law(
        (MAGNETOMETER,), lambda run, _s, p: np.outer(run.heater, _turned(run, p)), _draw_vector,
        coupled=True, needs=('heater',),
    ),
    'compressor_hard_iron': Law(
        (MAGNETOMETER,), lambda run, _s, p: np.outer(run.compressor, _turned(run, p)),
        _draw_vector, coupled=True, needs=('compressor',),
    ),
    'fixture_hard_iron': Law(
        (MAGNETOMETER,), lambda run, _s, p: np.outer(_x(run), _turned(run, p)), _draw_vector,
        coupled=True,
    ),
    'fixture_tilt': Law(
        (ACCELEROMETER, MAGNETOMETER), _tilt, _draw_vector, coupled=True, joint=True
    ),
    'mains_alias': Law((GYROSCOPE, MAGNETOMETER), _alias, _draw_alias),
    'icing': Law((ACCELEROMETER, GYROSCOPE), _icing, _draw_icing),
}  # fmt: skip
"""Names as the project prints them; laws from the notes on effects."""


# Laws outside the catalogue ----------------------------------------------------------------------


def _within(low: float, high: float, name: str = 'centre') -> Draw:
    """Return a draw of a temperature in the given part of the range met."""

    def draw(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
        cold, hot = _span(runs)
        share = rng.uniform(low, high)
        return {name: cold + share * (hot - cold), 'span': hot - cold, 'a': rng.uniform(0.0, 1.0)}

    return draw


def _branch(run: Conditions) -> Array:
    """Return the direction of the temperature, −1 … 1, without the noise of dwells."""
    return np.tanh(lag(run.rate, run.dt, 120.0) / (0.2 / 60.0))


def _fractional(run: Conditions, _sensor: str, p: Parameters) -> Array:
    """Return the half-integral memory of the temperature (Grünwald–Letnikov)."""
    step = max(1, int(10.0 / run.dt))
    x = run.die[::step] - run.die[0]
    k = np.arange(1, len(x))
    weights = np.concatenate([[1.0], np.cumprod((k - 1.0 - p['order']) / k)])
    n = 2 * len(x)
    answer = np.fft.irfft(np.fft.rfft(x, n) * np.fft.rfft(weights, n), n)[: len(x)]
    return np.interp(np.arange(len(run.die)), np.arange(len(x)) * step, answer)


def _moving_bump(run: Conditions, _sensor: str, p: Parameters) -> Array:
    shift = (0.06 + 0.1 * p['a']) * p['span'] * _branch(run)
    return np.exp(-0.5 * ((run.die - p['centre'] - shift) / (0.07 * p['span'])) ** 2)


def _telegraph(run: Conditions, _sensor: str, p: Parameters) -> Array:
    own = np.random.default_rng([p['seed'], int(abs(run.time[0]))])
    return switching(own, len(run.time), run.dt, p['mean_dwell'])


def _slip(run: Conditions, _sensor: str, p: Parameters) -> Array:
    return (run.time / p['period']) % 1.0


def _draw_period(low: float, high: float) -> Draw:
    def draw(rng: np.random.Generator, runs: Sequence[Conditions]) -> Parameters:
        return {'period': _longest(runs) * rng.uniform(low, high), 'phase': rng.uniform(0, 6.28)}

    return draw


OUTSIDE: Mapping[str, Law] = {
    'exponential_in_temperature': Law(
        ALL, lambda run, _s, p: np.exp(_x(run) / (0.16 * p['span'])), _within(0.0, 1.0)
    ),
    'cosine_in_temperature': Law(
        ALL,
        lambda run, _s, p: np.cos(2 * np.pi * (_x(run) / (0.35 * p['span']) + p['a'])),
        _within(0.0, 1.0),
    ),
    'tanh_in_temperature': Law(
        ALL,
        lambda run, _s, p: np.tanh((run.die - p['centre']) / (0.06 * p['span'])),
        _within(0.25, 0.75),
    ),
    'dead_zone': Law(
        ALL,
        lambda run, _s, p: np.maximum(np.abs(run.die - p['centre']) - 0.25 * p['span'], 0.0),
        _within(0.3, 0.7),
    ),
    'activity_dip': Law(
        ALL,
        lambda run, _s, p: np.exp(-0.5 * ((run.die - p['centre']) / (0.06 * p['span'])) ** 2),
        _within(0.2, 0.8),
    ),
    'bump_moving_with_branch': Law(ALL, _moving_bump, _within(0.3, 0.7)),
    'fractional_order_memory': Law(
        ALL, _fractional, lambda rng, _runs: {'order': rng.uniform(0.3, 0.7)}
    ),
    'rate_squared': Law(ALL, lambda run, _s, _p: (run.rate * 60.0) ** 2),
    'rate_times_temperature': Law(ALL, lambda run, _s, _p: run.rate * 60.0 * _x(run)),
    'slow_oscillation': Law(
        ALL,
        lambda run, _s, p: np.sin(2 * np.pi * run.time / p['period'] + p['phase']),
        _draw_period(0.04, 0.13),
    ),
    'sign_of_rate_relaxing': Law(
        ALL,
        lambda run, _s, p: _branch(run) - lag(_branch(run), run.dt, p['period']),
        _draw_period(0.02, 0.06),
    ),
    'random_telegraph': Law(
        ALL,
        _telegraph,
        lambda rng, runs: {
            'seed': int(rng.integers(1 << 30)),
            'mean_dwell': _longest(runs) / rng.uniform(6.0, 25.0),
        },
    ),
    'stick_and_slip': Law(ALL, _slip, _draw_period(0.05, 0.3)),
    'slope_changing_with_time': Law(ALL, lambda run, _s, _p: _x(run) * run.time / 3600.0),
    'highest_temperature_so_far': Law(
        ALL,
        lambda run, _s, p: np.tanh(
            (np.maximum.accumulate(run.die) - p['centre']) / (0.25 * p['span'])
        ),
        _within(0.4, 0.8),
    ),
    'late_transition': Law(
        ALL,
        lambda run, _s, p: np.tanh((run.power_on - 8.0 * p['period']) / (1.2 * p['period'])),
        _draw_period(0.04, 0.08),
    ),
}
"""Nothing in the catalogue has these forms, though some come near where a recording is short."""
