# SPDX-License-Identifier: Apache-2.0
"""The fleet: scaling of the engine, statistics of ten thousand devices, screening, shortening.

    python benchmarks/fleet.py [--devices N] [--scaling N] [--seed S]

Scaling: N simulated devices are estimated by one worker, then by two, in one run; what counts is
the time from the first to the last result. Statistics: rows of N devices as `fleet` writes them,
slopes drawn from the simulator's population, bins of temperature with white noise and dwells of a
quarter of an hour, evidence of effects drawn as χ², with coefficients in each of their forms; they
are studied and drawn in a process of its own, which reports its time and memory.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from imu_driver.simulation.population import draw_fleet_device, draw_lots
from imu_workbench.fleet.engine import Cluster, connected, outcomes
from imu_workbench.fleet.estimate import BIN_TIME_SHARES, EstimateSettings
from imu_workbench.fleet.page import fleet_page
from imu_workbench.fleet.sources import find_devices
from imu_workbench.fleet.statistics.vectors import SENSORS
from imu_workbench.fleet.study import study
from imu_workbench.fleet.table import ResultRow, write_rows
from imu_workbench.simulate.campaign import Logging
from imu_workbench.simulate.fleet import FleetPlan, write_fleet

LOTS = 8
RUNS = 3
TEMPERATURES = np.arange(15.0, 31.0)
DWELL_S = 900.0
SLOPE_STD = {'accelerometer': 3e-5, 'gyroscope': 6e-6, 'magnetometer': 3e-9}
"""Error of a slope in a `short_20min` campaign [SI unit/K]."""
TRIED = {
    'thermal_lag': np.geomspace(10.0, 3600.0, 13),
    'temperature_rate': None,
    'thermal_hysteresis': None,
    'warm_up': np.geomspace(60.0, 7200.0, 13),
}
"""Effects whose evidence is drawn, and the time constants of their forms [s]."""
BATCH = 500


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--devices', type=int, default=10_000)
    parser.add_argument('--scaling', type=int, default=24, help='devices; 0 leaves it out')
    parser.add_argument('--study', type=Path, help=argparse.SUPPRESS)
    parser.add_argument('--seed', type=int, default=3, help='of the population')
    options = parser.parse_args()
    if options.study:
        print(json.dumps(studied(options.study)))
        return
    if options.scaling:
        print_scaling(options.scaling, options.seed)
    print_statistics(options.devices, options.seed)


def print_scaling(devices: int, seed: int) -> None:
    with TemporaryDirectory() as folder:
        bags = Path(folder) / 'bags'
        write_fleet(FleetPlan('short_20min', devices, 2, seed, Logging(0.5, mean=True)), bags, 2)
        seconds = [estimated(bags, workers) for workers in (1, 2)]
    print(
        f'scaling: {devices} devices, 1 worker {seconds[0]:.1f} s, 2 workers {seconds[1]:.1f} s: '
        f'{seconds[0] / seconds[1]:.2f} × ({seconds[0] / devices:.2f} s a device and worker)'
    )


def estimated(bags: Path, workers: int) -> float:
    """Return the time of all devices, workers warm: each has done one device before."""
    devices = find_devices([str(bags)])
    with connected(Cluster(workers=workers)) as client:
        list(outcomes(client, devices[: 2 * workers], EstimateSettings()))
        start = time.perf_counter()
        rows = [row for found in outcomes(client, devices, EstimateSettings()) for row in found]
        seconds = time.perf_counter() - start
    failed = [row for row in rows if row['role'] == 'failed']
    if failed:
        raise RuntimeError(failed[0]['reason'])
    return seconds


def print_statistics(devices: int, seed: int) -> None:
    with TemporaryDirectory() as folder:
        truth = write_results(Path(folder), devices, seed)
        command = [sys.executable, __file__, '--study', folder]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    odd = set(found['odd'])
    seeded = {name for name, outlier in truth.items() if outlier}
    false = len(odd - seeded) / (devices - len(seeded))
    print(
        f'statistics, screening and page of {devices} devices: {found["seconds"]:.1f} s '
        f'({found["cpu_seconds"]:.1f} s of processor time), {found["mb"]:.0f} MB; '
        f'clusters {found["clusters"]} (lots {LOTS})'
    )
    print(
        f'screening: {len(odd & seeded)} of {len(seeded)} seeded outliers found '
        f'({100 * len(odd & seeded) / len(seeded):.1f} %), false alarms {100 * false:.2f} %'
    )
    print(f'shortening: {found["shortest"]}')
    for line in found['prevalence']:
        print(f'prevalence: {line}')


def write_results(folder: Path, devices: int, seed: int) -> dict[str, str]:
    """Write the rows of a drawn fleet; return what makes each device an outlier, '' for most."""
    lots = draw_lots(LOTS, seed)
    draw = np.random.default_rng(seed)
    outliers = {}
    rows: list[ResultRow] = []
    for number in range(devices):
        device = draw_fleet_device(lots, number, devices, seed)
        name = device.parameters.name
        outliers[name] = device.outlier
        carried = {(effect.name, effect.sensor) for effect in device.effects}
        for sensor, slopes in zip(SENSORS, device.slopes.reshape(3, 3), strict=True):
            misfit = float(np.exp(0.03 * draw.normal()))
            misfit *= 2.0 if (device.outlier, sensor) in carried else 1.0
            common = {'lot': device.lot, 'type': 'none', 'device': name, 'source': name,
                      'sensor': sensor, 'measured_at': number}  # fmt: skip
            rows += fitted(common, slopes, misfit, SLOPE_STD[sensor], draw)
            rows += tried(common, carried, draw)
        if (number + 1) % BATCH == 0 or number + 1 == devices:
            write_rows(folder, rows, number + 1)
            rows = []
    return outliers


def fitted(
    common: ResultRow, slopes: np.ndarray, misfit: float, std: float, draw: np.random.Generator
) -> list[ResultRow]:
    run = np.repeat(np.arange(RUNS), len(TEMPERATURES))
    x = np.tile(TEMPERATURES, RUNS)
    noise = std * np.sqrt(np.sum((x - x.mean()) ** 2))
    share = np.repeat(BIN_TIME_SHARES, len(x))
    rows = []
    for axis, slope in zip('xyz', slopes, strict=True):
        parts = (slope * (x - 20.0))[:, None] + 2.0 * noise * draw.normal(size=(len(x), 4))
        y = [parts[:, : int(4 * one)].mean(axis=1) for one in BIN_TIME_SHARES]
        each = np.array([np.polyfit(x[run == r], y[0][run == r], 1)[0] for r in range(RUNS)])
        rows.append(
            {
                **common, 'axis': axis, 'effect': 'bias_temperature', 'role': 'fitted',
                'unit': 'SI/K', 'coefficients': [float(each.mean())], 'std': [std],
                'run_coefficients': each.tolist(), 'held_out_rms': misfit, 'noise_floor': 1.0,
                'block_run': np.tile(run, len(BIN_TIME_SHARES)).tolist(),
                'block_share': share.tolist(),
                'block_temperature': np.tile(x, len(BIN_TIME_SHARES)).tolist(),
                'block_mean': np.concatenate(y).tolist(),
                'block_variance': (noise**2 / share).tolist(),
                'block_seconds': (DWELL_S * share).tolist(),
            }
        )  # fmt: skip
    return rows


def tried(
    common: ResultRow, carried: set[tuple[str, str]], draw: np.random.Generator
) -> list[ResultRow]:
    """Return evidence that is χ² where an effect is absent and three times that else."""
    rows = []
    for effect, shapes in TRIED.items():
        forms = 1 if shapes is None else len(shapes)
        size = 3.0 if (effect, common['sensor']) in carried else 1.0
        for axis in 'xyz':
            ratio = np.sqrt(size * draw.chisquare(1, forms))
            row = {
                **common, 'axis': axis, 'effect': effect, 'role': 'candidate', 'degrees': 1,
                'forms': [f'form {k}' for k in range(forms)], 'gain': (ratio**2).tolist(),
            }  # fmt: skip
            if shapes is not None:
                std = np.full(forms, 1e-6)
                kept = {'shapes': shapes, 'coefficients': ratio * std, 'std': std}
                row |= {name: values.tolist() for name, values in kept.items()}
            rows.append(row)
    return rows


def studied(folder: Path) -> dict[str, object]:
    start = time.perf_counter()
    found = study(folder)
    (folder / 'report.html').write_text(fleet_page(found, folder), 'utf-8')
    return {
        'seconds': time.perf_counter() - start,
        'cpu_seconds': time.process_time(),
        'mb': resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        'odd': sorted({one['device'] for one in found['odd']}),
        'clusters': [one['count'] for one in found['clusters']],
        'shortest': found['shortening']['shortest'],
        'prevalence': [
            f'{one["effect"]} in the {one["sensor"]} of {100 * one["share"]:.0f} % of lot '
            f'{one["lot"]}'
            for one in found['prevalence']
            if one['named']
        ],
    }


if __name__ == '__main__':
    main()
