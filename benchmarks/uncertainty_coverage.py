# SPDX-License-Identifier: Apache-2.0
"""How often the intervals of a certificate hold the truth: devices simulated to the die, fitted.

python benchmarks/uncertainty_coverage.py [--devices 1000] [--seed 1]

Each device is three runs of four thermal cycles. Its physics shares no formula with the fit or
the budget: a body with two thermal nodes is led through a trapezoid by Euler's method; the die's
thermometer reads with an error of its own at either end, drawn within the stated calibration; the
slope of every run and every cycle differs; noise is white plus an autoregressive process. Stated
is what a laboratory knows: the calibration of the thermometer. The accelerometer's element lags
behind the die, with a time constant that differs by run and cycle, too. Counted is how often
value ± k95·u holds the gyroscope's slopes and the time constant that were put in.
"""

from __future__ import annotations

import argparse
import json
import warnings

import numpy as np
from imu_recording.recording import PHASES
from imu_workbench.report.certificate.quantities import quantities
from imu_workbench.report.laboratory import Laboratory
from scipy.signal import lfilter
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.fitting.fit import fit_prepared

from imu_recording import ImuRecording

RUNS, CYCLES = 3, 4
PERIOD_S = 10.0
LEGS = (('ramp_down', 900, -10.0), ('dwell_cold', 900, -10.0), ('ramp_up', 1800, 50.0),
        ('dwell_hot', 900, 50.0), ('ramp_down', 900, 20.0))  # fmt: skip
CALIBRATION_K = 0.15
"""Standard uncertainty of the thermometer's calibration."""
GRADIENT_K = 0.2
"""Half-width of what the sensing element differs from the thermometer by, at either end."""
STEP_S = 1.0
"""Of the integration of the lag."""


def plan() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return set-point, phase and cycle of a run."""
    parts = [(np.full(90, 20.0), np.full(90, PHASES.index('precondition')), np.zeros(90, int))]
    level = 20.0
    for cycle in range(1, CYCLES + 1):
        for phase, seconds, target in LEGS:
            n = round(seconds / PERIOD_S)
            parts.append(
                (np.linspace(level, target, n), np.full(n, PHASES.index(phase)), np.full(n, cycle))
            )
            level = target
    setpoint, phases, cycles = (np.concatenate(p) for p in zip(*parts, strict=True))
    return setpoint, phases, cycles


def two_nodes(air: np.ndarray) -> np.ndarray:
    """Return the temperature of the die behind board and package, by Euler's method."""
    board = die = air[0]
    found = np.empty_like(air)
    for i, outside in enumerate(air):
        board += PERIOD_S * (outside - board) / 180.0
        die += PERIOD_S * (board - die) / 20.0
        found[i] = die
    return found


def behind(die: np.ndarray, time_constant: np.ndarray) -> np.ndarray:
    """Return the temperature of an element that lags behind the die, by Euler's method."""
    steps = round(PERIOD_S / STEP_S)
    level = die[0]
    found = np.empty_like(die)
    for i, (before, after) in enumerate(zip(np.r_[die[0], die[:-1]], die, strict=True)):
        for outside in np.linspace(before, after, steps, endpoint=False):
            level += STEP_S * (outside - level) / time_constant[i]
        found[i] = level
    return found


def device(generator: np.random.Generator) -> tuple[list[ImuRecording], np.ndarray]:
    """Return the recordings of one device, its slopes (3,) [rad/s/K] and time constant [s]."""
    setpoint, phase, cycle = plan()
    truth = generator.uniform(-1e-4, 1e-4, 3)
    run_scatter, cycle_scatter = 10.0 ** generator.uniform(-7.5, -6.0, 2)
    calibrated = generator.normal(0.0, CALIBRATION_K, 2)
    gradient = generator.uniform(-GRADIENT_K, GRADIENT_K, 1) * [-0.5, 0.5]
    time_constant = generator.uniform(60.0, 200.0)
    run_lag, cycle_lag = 10.0 ** generator.uniform(-3.0, -1.3, 2)
    lag_size = generator.uniform(2e-4, 2e-3, 3) * generator.choice([-1.0, 1.0], 3)
    recordings = []
    for r in range(RUNS):
        die = two_nodes(setpoint) + 1.0
        share = (die + 10.0) / 60.0
        shown = die + (1.0 - share) * calibrated[0] + share * calibrated[1]
        own = die + (1.0 - share) * gradient[0] + share * gradient[1]
        slopes = truth + generator.normal(0.0, run_scatter, 3)
        by_cycle = slopes + generator.normal(0.0, cycle_scatter, (CYCLES + 1, 3))
        n = len(die)
        slow = lfilter([1.0], [1.0, -0.99], generator.normal(0.0, 1e-6, (n, 3)), axis=0)
        measured = by_cycle[cycle] * (own - 20.0)[:, None] + slow
        measured += generator.normal(0.0, 5e-5, (n, 3)) + generator.normal(0.0, 1e-3, 3)
        scatter = generator.normal(0.0, run_lag) + generator.normal(0.0, cycle_lag, CYCLES + 1)
        element = behind(die, (time_constant * (1.0 + scatter))[cycle])
        force = 9.80665 * np.eye(3)[r] + np.outer(element - die, lag_size)
        force += lfilter([1.0], [1.0, -0.99], generator.normal(0.0, 2e-5, (n, 3)), axis=0)
        force += generator.normal(0.0, 1e-3, (n, 3))
        recordings.append(
            ImuRecording(
                stamp=(1_700_000_000 + 86_400 * r + np.arange(n) * int(PERIOD_S)) * 10**9,
                angular_velocity=measured,
                linear_acceleration=force,
                magnetic_field=np.full((n, 3), np.nan),
                temperature=shown,
                setpoint=setpoint,
                phase=phase,
                cycle=cycle,
                device='simulated',
                run=f'run {r}',
                up_axis=f'+{"xyz"[r]}',
            )
        )
    return recordings, np.r_[truth, time_constant]


def intervals(recordings: list[ImuRecording], truth: np.ndarray) -> list[tuple[float, float]]:
    """Return deviation from the truth and half-width of the 95 % interval of slopes and lag."""
    stated = Laboratory(
        {
            'thermometer': {'expanded_uncertainty': 2.0 * CALIBRATION_K},
            'gradient': {'half_width': GRADIENT_K, 'unit': 'K'},
        }
    )
    runs = prepare(recordings, period=20.0)
    line = BiasTemperature()
    model = fit_prepared({'gyroscope': [line], 'accelerometer': [line, ThermalLag()]}, runs)
    found = quantities(model, runs, [r.up_axis for r in recordings], stated)
    wanted = [
        *(q for q in found if q.coefficient == 'slope' and q.sensor == 'gyroscope'),
        *(q for q in found if q.shape),
    ]
    return [
        (q.budget.value - true, q.budget.coverage_factor * q.budget.combined)
        for q, true in zip(wanted, truth, strict=True)
    ]


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--devices', type=int, default=1000)
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter('ignore')
    found = np.array(
        [
            intervals(*device(np.random.default_rng((options.seed, number))))
            for number in range(options.devices)
        ]
    )
    held = np.abs(found[..., 0]) <= found[..., 1]
    counted = {'slope': slice(0, 3), 'time_constant': slice(3, 4)}
    print(
        json.dumps(
            {
                'devices': options.devices,
                **{
                    name: {
                        'coverage': round(float(held[:, part].mean()), 4),
                        'coverage_by_axis': held[:, part].mean(axis=0).round(4).tolist(),
                        'median_half_width': float(np.median(found[:, part, 1])),
                        'rms_deviation': float(np.sqrt((found[:, part, 0] ** 2).mean())),
                    }
                    for name, part in counted.items()
                },
            }
        )
    )


if __name__ == '__main__':
    main()
