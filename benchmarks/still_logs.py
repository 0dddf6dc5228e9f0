# SPDX-License-Identifier: Apache-2.0
"""Curves from still minutes against a chamber: python benchmarks/still_logs.py [--devices N].

Each device is simulated here, with formulas that neither the fit nor the project's simulator
share: its curve is a line, a saturating bend and a bump over the temperature of an element that
lags behind the thermometer; flicker is a sum of autoregressive processes, values are counts.
LOGS flights are days apart. Each has a power-on of its own and stands on the ground, in a pose of
its own, for 3 to 10 minutes in all, warms up on its own, is carried about and flies. The chamber
runs three orientations of four cycles, −10 … 50 °C, of the same device. Judged on another two
cycles in the chamber, within the temperatures the logs have visited: rms of means over 20 s about
the level of the run, and how often value ± 1.96 standard deviations hold the true curve. Exit code
1 where a claim fails.

What limits the accelerometer is how little the logs tell across gravity: there the level of a
stretch is that of its pose, and the curve is put together from warm-ups of a few kelvin. With lag,
its share and the form given, the curve is wrong by 0.4 to 0.8 mm/s² (devices 902 … 907; noise
leaves 0.7 in the chamber, so a ratio of about 1.4); searched for, by 0.4 to 1.1, and a lag that
follows a bent curve is one number in the model (device 902: 2.9 mm/s² of its 3.2 on y). Shorter
lags, the share as a further unknown, and means over the forms make it no better on average.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # as the verbs: two spin for each other

import numpy as np
from imu_recording.recording import FloatArray
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.bias_temperature_curvature import BiasTemperatureCurvature
from thermal_comp.fitting.empirical import empirical_form
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ThermalModel
from thermal_comp.noise.of_runs import noise_of_runs
from thermal_comp.still.curves import StillCurves, still_curves
from thermal_comp.still.log import resting_log
from verdict import Verdict, judge

from imu_recording import ImuRecording

SENSORS: tuple[Sensor, ...] = ('accelerometer', 'gyroscope')
FIELDS = {'accelerometer': 'linear_acceleration', 'gyroscope': 'angular_velocity'}
DEG = np.pi / 180.0
SLOPES = {'accelerometer': 4e-3, 'gyroscope': 0.02 * DEG}
"""[unit/K]."""
OFFSETS = {'accelerometer': 0.3, 'gyroscope': 2.0 * DEG}
TURN_ON = {'accelerometer': 0.02, 'gyroscope': 0.04 * DEG}
ONE_SECOND = {'accelerometer': 1.04e-3, 'gyroscope': 7.1e-3 * DEG}
"""Standard deviation of a one-second mean, without flicker."""
COUNTS = {'accelerometer': 0.6e-3, 'gyroscope': 0.06 * DEG}
THERMOMETER_NOISE_K, THERMOMETER_COUNT_K = 0.05, 0.0625
SLOW_S = (40.0, 400.0, 4000.0)
FLICKER = 0.4
"""Standard deviation of each slow process, in one-second means."""
AGEING = {'accelerometer': 0.03, 'gyroscope': 0.03 * DEG}
"""Standard deviation of the change of a level in a year."""
G = 9.81
EARTH_RATE = 7.292e-5
FIRST_NS, DAY_NS = 1_700_000_000 * 10**9, 86_400 * 10**9
COLDEST, HOTTEST = -5.0, 45.0
BLOCK_S = 20.0
RATIO, COVERAGE = 1.5, (0.90, 0.99)


@dataclass(frozen=True)
class Curve:
    """A line, a saturating bend and a bump, of each axis."""

    line: FloatArray
    bend: FloatArray
    knee: FloatArray
    width: FloatArray
    bump: FloatArray
    centre: FloatArray

    def __call__(self, temperature: FloatArray) -> FloatArray:
        """Return the (n, 3) error at temperatures (n,) of the element [°C]."""
        x = temperature[:, None]
        bend = self.bend * np.arctan((x - self.knee) / self.width)
        bump = self.bump / np.cosh((x - self.centre) / 12.0)
        value: FloatArray = self.line * x + bend + bump
        return value


@dataclass(frozen=True)
class Device:
    """Curves and noise of one device."""

    name: str
    curve: dict[str, Curve]
    offset: dict[str, FloatArray]
    ageing: dict[str, FloatArray]
    lag_s: float
    lag_share: float
    """Part of the way from the thermometer's temperature to the lagging one."""


def draw_device(seed: int) -> Device:
    rng = np.random.default_rng([seed, 1])
    curve, offset, ageing = {}, {}, {}
    for sensor in SENSORS:
        slope = SLOPES[sensor]
        curve[sensor] = Curve(
            line=slope * np.exp(rng.uniform(-1.0, 1.0, 3)) * rng.choice([-1.0, 1.0], 3),
            bend=30.0 * slope * rng.uniform(-0.8, 0.8, 3),
            knee=rng.uniform(0.0, 40.0, 3),
            width=rng.uniform(8.0, 25.0, 3),
            bump=5.0 * slope * rng.uniform(-1.0, 1.0, 3),
            centre=rng.uniform(0.0, 40.0, 3),
        )
        offset[sensor] = rng.normal(0.0, OFFSETS[sensor], 3)
        ageing[sensor] = rng.normal(0.0, AGEING[sensor], 3)
    share = float(rng.choice([1.0, rng.uniform(0.4, 1.6)]))
    return Device(f'quad{seed}', curve, offset, ageing, rng.uniform(5.0, 40.0), share)


def noise_of(n: int, rate: float, sensor: str, rng: np.random.Generator) -> FloatArray:
    total: FloatArray = np.sqrt(rate) * rng.standard_normal((n, 3))
    for seconds in SLOW_S:
        a = np.exp(-1.0 / (rate * seconds))
        kicks = np.sqrt(1.0 - a * a) * rng.standard_normal((n, 3))
        begin = a * rng.standard_normal((1, 3))
        total += FLICKER * lfilter([1.0], [1.0, -a], kicks, axis=0, zi=begin)[0]
    return ONE_SECOND[sensor] * total


def behind(t: FloatArray, dt: float, seconds: float) -> FloatArray:
    a = np.exp(-dt / max(seconds, 1e-6))
    return np.asarray(lfilter([1.0 - a], [1.0, -a], t, zi=[a * t[0]])[0])


@dataclass(frozen=True)
class PowerOn:
    """When and how a device was switched on."""

    name: str
    start_ns: int
    years: float = 0.0
    """Since the device was new."""
    up_axis: str = ''


def recorded(
    device: Device,
    power_on: PowerOn,
    temperature: FloatArray,
    rate: float,
    true: dict[str, FloatArray],
    rng: np.random.Generator,
) -> ImuRecording:
    """Return what is logged of a die temperature (n,) and true inputs (n, 3)."""
    n = len(temperature)
    lagging = behind(temperature, 1.0 / rate, device.lag_s)
    element = temperature + device.lag_share * (lagging - temperature)
    columns = {}
    for sensor in SENSORS:
        level = device.offset[sensor] + rng.normal(0.0, TURN_ON[sensor], 3)
        error = device.curve[sensor](element) + level + power_on.years * device.ageing[sensor]
        values = true[sensor] + error + noise_of(n, rate, sensor, rng)
        columns[FIELDS[sensor]] = np.round(values / COUNTS[sensor]) * COUNTS[sensor]
    read = temperature + rng.normal(0.0, THERMOMETER_NOISE_K, n)
    return ImuRecording(
        stamp=power_on.start_ns + np.round(np.arange(n) * (1e9 / rate)).astype(np.int64),
        magnetic_field=np.full((n, 3), np.nan),
        temperature=np.round(read / THERMOMETER_COUNT_K) * THERMOMETER_COUNT_K,
        device=device.name,
        run=power_on.name,
        up_axis=power_on.up_axis,
        **columns,
    )


def flight(
    device: Device, number: int, logs: int, rate: float, rng: np.random.Generator
) -> ImuRecording:
    """Return one log: rest, carried, rest elsewhere, flight, rest."""
    rest_s = 60.0 * rng.uniform(3.0, 10.0)
    parts = rest_s * rng.dirichlet([6.0, 3.0, 3.0])
    moves = rng.uniform(20.0, 60.0, 2) * [1.0, 3.0]
    lengths = [parts[0], moves[0], parts[1], moves[1], parts[2]]
    n = round(sum(lengths) * rate)
    time = np.arange(n) / rate
    place = np.searchsorted(np.cumsum(lengths)[:-1], time)
    spread = (number + rng.uniform(0.0, 1.0)) / logs
    ambient = COLDEST + spread * (HOTTEST - COLDEST - 8.0)
    warm = rng.uniform(4.0, 12.0)
    temperature = ambient + warm * (1.0 - np.exp(-time / rng.uniform(120.0, 400.0)))
    temperature = np.minimum(temperature, HOTTEST)
    attitude = [_on_the_ground(rng) for _ in range(3)]
    true = {'accelerometer': np.zeros((n, 3)), 'gyroscope': np.zeros((n, 3))}
    north = EARTH_RATE * np.array([0.0, np.cos(0.8), np.sin(0.8)])
    for k in range(5):
        rows = place == k
        if k % 2 == 0:
            turn = attitude[k // 2]
            true['accelerometer'][rows] = turn.apply([0.0, 0.0, G])
            true['gyroscope'][rows] = turn.apply(north)
        else:
            force, rates = _moved(int(rows.sum()), rate, rng, hard=k == 3)
            true['accelerometer'][rows], true['gyroscope'][rows] = force, rates
    days = int(rng.integers(365))
    power_on = PowerOn(f'log{number:02d}', FIRST_NS + days * DAY_NS, days / 365.25)
    return recorded(device, power_on, temperature, rate, true, rng)


def _on_the_ground(rng: np.random.Generator) -> Rotation:
    """Return the attitude of a vehicle that stands on its skids, somewhere."""
    tilt = rng.normal(0.0, 4.0, 2)
    return Rotation.from_euler('zyx', [rng.uniform(0.0, 360.0), *tilt], degrees=True)


def _moved(
    n: int, rate: float, rng: np.random.Generator, *, hard: bool
) -> tuple[FloatArray, FloatArray]:
    """Return specific force and rate of something carried or flown: slow noise and shaking."""
    a = np.exp(-1.0 / (rate * 0.5))
    size = np.array([1.0, 1.0, 0.6]) * (1.5 if hard else 0.6)
    slow = lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], rng.standard_normal((n, 6)), axis=0)
    shake = 2.0 * rng.standard_normal((n, 3)) if hard else 0.0
    return slow[:, :3] + [0.0, 0.0, G] + shake, slow[:, 3:] * size


def chamber_run(
    device: Device, number: int, cycles: int, rng: np.random.Generator
) -> ImuRecording:
    """Return a run in a chamber: 20 → −10 → 50 → 20 °C, a mean a second."""
    legs = [(1200, 20.0)]
    for _ in range(cycles):
        legs += [(1500, -10.0), (900, -10.0), (3000, 50.0), (900, 50.0), (1500, 20.0)]
    level, parts = 20.0, []
    for seconds, target in legs:
        parts.append(np.linspace(level, target, seconds))
        level = target
    air = np.concatenate(parts)
    temperature = behind(air, 1.0, 200.0)
    up = np.roll([G, 0.0, 0.0], number)
    n = len(air)
    true = {'accelerometer': np.tile(up, (n, 1)), 'gyroscope': np.zeros((n, 3))}
    power_on = PowerOn(f'chamber{number}', FIRST_NS, up_axis='+' + 'xyz'[number])
    return recorded(device, power_on, temperature, 1.0, true, rng)


def chamber_model(recordings: list[ImuRecording]) -> ThermalModel:
    """Return the best a chamber does: a cubic, and the empirical term where it helps."""
    runs = prepare(recordings)
    cubic = (BiasTemperature(), BiasTemperatureCurvature())
    effects: dict[Sensor, tuple[Any, ...]] = {}
    for sensor in SENSORS:
        form = empirical_form(runs, sensor, cubic, noise_of_runs(runs, sensor, cubic)[0])
        effects[sensor] = cubic if form is None else (*cubic, form)
    return fit_prepared(effects, runs)


def left_in(
    model: ThermalModel, run: ImuRecording, inside: tuple[float, float]
) -> dict[str, FloatArray]:
    """Return (3,) rms of means over 20 s about the run's level, within some temperatures."""
    prepared = prepare([run], period=BLOCK_S)[0]
    seen = (prepared.temperature >= inside[0]) & (prepared.temperature <= inside[1])
    found = {}
    for sensor in SENSORS:
        error = prepared.block_mean(
            model.sensors[sensor].modelled_error(prepared.conditions.of(sensor))[0]
        )
        left = (prepared.measured[sensor] - error)[seen]
        found[sensor] = np.sqrt(((left - left.mean(axis=0)) ** 2).mean(axis=0))
    return found


def still_of(device: Device, logs: int, rate: float, seed: int) -> StillCurves:
    rng = np.random.default_rng([seed, 2])
    resting = []
    for number in range(logs):
        log = flight(device, number, logs, rate, rng)
        resting.append(resting_log(log)[0])
    return still_curves(resting)


def judged(seed: int, logs: int, rate: float) -> dict[str, Any]:
    """Return what stills and chamber leave of one device, and how often bands hold."""
    device = draw_device(seed)
    curves = still_of(device, logs, rate, seed)
    rng = np.random.default_rng([seed, 3])
    chamber = chamber_model([chamber_run(device, k, 4, rng) for k in range(3)])
    low, high = curves.temperature[curves.minutes > 0.0][[0, -1]]
    fresh = chamber_run(device, 2, 2, rng)
    own, other = (left_in(m, fresh, (low, high)) for m in (curves.model, chamber))
    grid = np.arange(np.ceil(low), np.floor(high) + 0.5)
    row: dict[str, Any] = {'seed': seed, 'visited': [low, high], 'odd': list(curves.odd)}
    for sensor in SENSORS:
        value, std = curves.curve(sensor, grid)
        true = device.curve[sensor](np.append(grid, 20.0))
        off = value - (true[:-1] - true[-1])
        away = grid != 20.0
        row[sensor] = {
            'still': own[sensor].tolist(),
            'chamber': other[sensor].tolist(),
            'ratio': float(np.sqrt((own[sensor] ** 2).mean() / (other[sensor] ** 2).mean())),
            'curve_rms': np.sqrt((off**2).mean(axis=0)).tolist(),
            'std_rms': np.sqrt((std**2).mean(axis=0)).tolist(),
            'within': (np.abs(off) <= 1.96 * std)[away].mean(axis=0).tolist(),
        }
    return row


def main() -> int:
    """Judge the devices and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--devices', type=int, default=20)
    parser.add_argument('--logs', type=int, default=30)
    parser.add_argument('--rate', type=float, default=50.0, help='of the logs [Hz]')
    parser.add_argument('--seed', type=int, default=1, help='of the first device')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    rows = []
    for seed in range(options.seed, options.seed + options.devices):
        rows.append(judged(seed, options.logs, options.rate))
        said = '; '.join(
            f'{s} {rows[-1][s]["ratio"]:.2f} × chamber, bands {np.mean(rows[-1][s]["within"]):.0%}'
            for s in SENSORS
        )
        print(f'{seed}: {said}', flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))
    verdicts = []
    for sensor in SENSORS:
        ratios = [row[sensor]['ratio'] for row in rows]
        held = float(np.mean([row[sensor]['within'] for row in rows]))
        above = float(np.mean(np.array(ratios) > RATIO))
        print(f'{sensor}: largest ratio {max(ratios):.2f}, above {RATIO} in {above:.0%}')
        band = f'{sensor}: share of the curve within its 95 % band'
        verdicts += [
            Verdict(f'{sensor}: still against chamber, median', float(np.median(ratios)), RATIO),
            Verdict(band, held, COVERAGE[0], at_least=True),
            Verdict(band, held, COVERAGE[1]),
        ]
    return 1 if judge(verdicts) else 0


if __name__ == '__main__':
    raise SystemExit(main())
