# SPDX-License-Identifier: Apache-2.0
"""Does the short campaign that `plan --fleet` writes keep its promise on devices it never saw?

    python -m imu_workbench simulate short_20min --fleet 200 --lots 4 --seed 3 -o fleet_bags
    python -m imu_workbench fleet fleet_bags -o fleet_out
    python benchmarks/fleet_short.py fleet_out --lots 4 --seed 3 [--devices N]

N further devices of the same lots are simulated. Each is measured by the short campaign and fitted
as `fit --fleet` does, and by the full one, of which all runs but one make the reference; both are
judged on the run left out. The ratio is that of the study: over all devices and axes, each in
units of its sensor's median.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from chamber_profile.profile.file import profile_text
from imu_driver.simulation.hidden import hide_anything
from imu_driver.simulation.population import FleetDevice, draw_fleet_device, draw_lots
from imu_recording.recording import FloatArray
from imu_workbench.fleet.estimate import LINE_EFFECT
from imu_workbench.fleet.short_profile import short_profile
from imu_workbench.fleet.statistics.prior import fleet_prior, with_prior
from imu_workbench.fleet.statistics.vectors import SENSORS
from imu_workbench.fleet.study import fleet_curve
from imu_workbench.simulate.campaign import Logging, prepare_campaign, record_campaign
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.values import ThermalModel

from imu_recording import ImuRecording

FIRST = 100_000
"""Number of the first further device: a fleet has fewer."""
BOOTSTRAPS = 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('results', type=Path)
    parser.add_argument('--profile', default='short_20min', help='of the full campaign')
    parser.add_argument('--lots', type=int, required=True)
    parser.add_argument('--seed', type=int, required=True)
    parser.add_argument('--devices', type=int, default=40)
    options = parser.parse_args()
    shortest = fleet_curve(options.results)['shortest']
    print(f'{shortest["temperatures"]} temperatures, {shortest["poses"]} poses, '
          f'{shortest["hours"]:.2f} h, promised {shortest["ratio"]:.3f}')  # fmt: skip
    with TemporaryDirectory() as folder:
        short = Path(folder) / 'short.yaml'
        short.write_text(profile_text(short_profile(shortest)), 'utf-8')
        found = [
            squares_of(device, options, str(short), shortest['poses'])
            for device in further(options.lots, options.devices, options.seed)
        ]
    draw = np.random.default_rng(1)
    chosen = draw.integers(len(found), size=(BOOTSTRAPS, len(found)))
    for k, sensor in enumerate(SENSORS):
        one, other = np.array([pair[:, k] for pair in found]).transpose(1, 0, 2)
        scale = np.median(other, axis=0)
        short_error, full_error = (one / scale).mean(axis=1), (other / scale).mean(axis=1)
        ratio = np.sqrt(short_error[chosen].mean(axis=1) / full_error[chosen].mean(axis=1))
        low, high = np.quantile(ratio, [0.05, 0.95])
        mean = np.sqrt(short_error.mean() / full_error.mean())
        print(f'{sensor}: {mean:.3f} ({low:.3f} … {high:.3f}) on {len(found)} further devices')


def further(lots: int, devices: int, seed: int) -> list[FleetDevice]:
    """Return ordinary devices of the lots whose numbers no fleet has."""
    chosen = draw_lots(lots, seed)
    found = []
    for k in range(devices):
        one = chosen[k % lots]
        device = draw_fleet_device([one], FIRST + k, FIRST + devices, seed)
        found += [device] if not device.outlier else []
    return found


def squares_of(
    device: FleetDevice, options: argparse.Namespace, short: str, poses: int
) -> FloatArray:
    """Return (2, 3, 3) mean squares of the short and the full campaign by sensor and axis."""
    cut = prepare(campaign(device, short, options.seed)[:poses])
    model = fit_prepared([LINE_EFFECT], cut)
    prior = fleet_prior(options.results, device.lot, 'none', device.parameters.name)
    model, _ = with_prior(model, cut, prior)
    whole = prepare(campaign(device, options.profile, options.seed))
    squares = []
    for held in whole:
        others = [run for run in whole if run is not held]
        squares.append([left(one, held) for one in (model, fit_prepared([LINE_EFFECT], others))])
    return np.mean(squares, axis=0)


def campaign(device: FleetDevice, profile: str, seed: int) -> list[ImuRecording]:
    number = int(device.parameters.name[1:])
    runs = prepare_campaign(
        profile, device.parameters, seed=seed + number, chamber_seed=seed + ord(device.lot)
    )
    for one in device.effects:
        runs = hide_anything(
            runs, one.name, magnitude=one.magnitude, seed=one.seed, sensor=one.sensor
        ).runs
    recordings = record_campaign(runs, Logging(0.5, mean=True))
    return [replace(one, device=device.parameters.name) for one in recordings]


def left(model: ThermalModel, run: PreparedRun) -> FloatArray:
    """Return (3, 3) mean squares that a model leaves of a run about its level."""
    found = []
    for sensor in SENSORS:
        columns = run.columns(LINE_EFFECT, sensor)
        rest = run.measured[sensor] - columns @ model.sensors[sensor].coefficients[0]
        rest = rest[np.isfinite(rest).all(axis=1)]
        found.append(((rest - rest.mean(axis=0)) ** 2).mean(axis=0))
    return np.array(found)


if __name__ == '__main__':
    main()
