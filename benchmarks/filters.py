# SPDX-License-Identifier: Apache-2.0
"""Speed and rest of the orientation filters: python benchmarks/filters.py [--live 60].

Batch over 400 000 nine-axis samples at 100 Hz, every filter beside its peers in turn, nine rounds,
medians. CPU time, so that other work on the machine counts less. All of our columns are returned
(attitude, covariance, bias, flags). Then 12 h at 100 Hz through both filters, one update called
from Python, and what the filters find at rest. With --live SECONDS also a node at 1 kHz over DDS,
and driver, compensation and filter as three processes. One line for each claim at the end; exit
code 1 where one does not hold.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imufusion
import numpy as np
from filterpy.kalman import KalmanFilter
from filters_static import static
from orientation_filters.ahrs import filterpy_kalman
from orientation_filters.filters import FILTERS, filter_parameters, run_filter, state_bytes
from orientation_filters.sample_checks import Sample
from verdict import Verdict, judge
from vqf import VQF

from imu_recording import ImuRecording

RATE_HZ = 100.0
PEER_SAMPLES = 20_000
"""For peers that are called sample by sample."""
FILTERPY_SAMPLES = 2_000
LIMITS = {
    ('complementary', 'paper'): 0.15,
    ('ahrs', 'paper'): 0.5,
    ('complementary', 'robust'): 0.25,
    ('ahrs', 'robust'): 0.3,
}
"""Largest part of VQF's batch time."""
LEAST_OVER_FILTERPY = 100.0
TWELVE_HOURS_S = 2.0
CHAIN_P99_MS = 10.0
BAGS = Path(__file__).resolve().parents[1] / 'bags'


def recording(samples: int, seed: int = 1) -> ImuRecording:
    """Return noisy slow rotation about a wandering axis."""
    rng = np.random.default_rng(seed)
    seconds = np.arange(samples) / RATE_HZ
    swing = 0.5 * np.sin(0.3 * seconds)[:, None] * [1.0, 0.5, 0.2]
    tilt = np.column_stack([np.sin(swing[:, 1]), -np.sin(swing[:, 0]), np.cos(swing[:, 0])])
    field = np.column_stack([np.sin(swing[:, 2]), np.cos(swing[:, 2]), np.full(samples, -1.7)])
    return ImuRecording(
        stamp=(np.arange(samples) * 10_000_000).astype(np.int64),
        angular_velocity=0.15 * np.cos(0.3 * seconds)[:, None] * [1.0, 0.5, 0.2]
        + 0.01 * rng.standard_normal((samples, 3)),
        linear_acceleration=9.81 * tilt + 0.05 * rng.standard_normal((samples, 3)),
        magnetic_field=25e-6 * field + 3e-7 * rng.standard_normal((samples, 3)),
        temperature=np.full(samples, 20.0),
    )


def cpu(function: Callable[[], object]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def batch(samples: int, rounds: int) -> dict[str, float]:
    """Return median ns per sample by name."""
    data = recording(samples)
    microtesla = data.magnetic_field * 1e6
    part = data.rows(slice(0, PEER_SAMPLES))
    short = data.rows(slice(0, FILTERPY_SAMPLES))
    contestants: dict[str, tuple[int, Callable[[], object]]] = {
        'VQF updateBatch': (
            samples,
            lambda: VQF(1 / RATE_HZ).updateBatch(
                data.angular_velocity, data.linear_acceleration, microtesla
            ),
        ),
        'imufusion, sample by sample': (len(part), lambda: run_imufusion(part)),
        'filterpy, predict and update': (len(short), lambda: run_filterpy(len(short))),
        'AHRS on filterpy': (
            len(short),
            lambda: filterpy_kalman.run(short, filter_parameters('ahrs').kernel_params()),
        ),
    }
    for name, preset in LIMITS:
        params = filter_parameters(name, preset=preset).kernel_params()
        contestants[f'{name} {preset}'] = (
            samples,
            lambda run=FILTERS[name].run, params=params: run(data, params),
        )
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for name in contestants:
        contestants[name][1]()
    for _ in range(rounds):
        for name, (count, function) in contestants.items():
            times[name].append(cpu(function) / count * 1e9)
    return {name: statistics.median(values) for name, values in times.items()}


def run_imufusion(data: ImuRecording) -> None:
    ahrs = imufusion.Ahrs()
    ahrs.set_sample_period(1 / RATE_HZ)
    degrees = np.degrees(data.angular_velocity)
    for w, f, m in zip(degrees, data.linear_acceleration / 9.81, data.magnetic_field, strict=True):
        ahrs.update(w, f, m)


def run_filterpy(samples: int) -> None:
    """Twelve states, six measurements, matrices ready: what filterpy alone costs."""
    kalman = KalmanFilter(dim_x=12, dim_z=6)
    kalman.H = np.hstack([np.eye(6), np.eye(6)])
    z = np.zeros((6, 1))
    for _ in range(samples):
        kalman.predict()
        kalman.update(z)


def twelve_hours() -> float:
    """Return the seconds both filters need for 4.32 million samples, warm."""
    data = recording(4_320_000)
    spent = [cpu(lambda n=name: run_filter(n, data)) for name in FILTERS]
    return sum(spent)


def one_update() -> dict[str, float]:
    """Return µs per `update` called from Python."""
    data = recording(2_000)
    rows = [
        Sample(stamp, tuple(w), tuple(f), tuple(m))
        for stamp, w, f, m in zip(
            data.stamp.tolist(),
            data.angular_velocity.tolist(),
            data.linear_acceleration.tolist(),
            data.magnetic_field.tolist(),
            strict=True,
        )
    ]
    spent = {}
    for name, preset in LIMITS:
        params = filter_parameters(name, preset=preset).kernel_params()
        update, state = FILTERS[name].update, FILTERS[name].initial_state()
        state, _ = update(state, params, rows[0])
        start = time.process_time()
        for row in rows[1:]:
            state, _ = update(state, params, row)
        spent[f'{name} {preset}'] = (time.process_time() - start) / len(rows) * 1e6
    return spent


def live(*arguments: str) -> dict[str, Any]:
    """Run filters_live.py in a process of its own; return what it measured."""
    code = Path(__file__).with_name('filters_live.py')
    done = subprocess.run(
        [sys.executable, str(code), *arguments], capture_output=True, text=True, check=True
    )
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def run_live(seconds: float) -> dict[str, dict[str, Any]]:
    """Return losses, latency and CPU: one node at 1 kHz, and the chain at 238 Hz."""
    results = {'1 kHz': live('node', str(seconds), '1000')}
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / 'dut1.yaml'
        bags = [str(BAGS / f'dut1_{axis}') for axis in 'xyz']
        fit = [sys.executable, '-m', 'imu_workbench', 'fit', *bags, '-o', str(model), '--force']
        subprocess.run(fit, check=True, capture_output=True)
        results['chain at 238 Hz'] = live('chain', str(seconds), str(model))
    return results


def report(results: dict[str, Any]) -> None:
    """Print what was measured."""
    nanoseconds = results['batch_ns']
    vqf = nanoseconds['VQF updateBatch']
    print(f'{"":32}{"ns/sample":>11}{"of VQF":>9}')
    for name, value in nanoseconds.items():
        print(f'{name:32}{value:11.1f}{value / vqf:9.3f}')
    for name, value in results['update_us'].items():
        size = state_bytes(*name.split())
        print(f'one update of {name}: {value:.1f} µs, state {size} B')
    for name, value in results.get('live', {}).items():
        print(f'live, {name}: {", ".join(f"{k} {v}" for k, v in value.items())}')


def verdicts(results: dict[str, Any]) -> list[Verdict]:
    """Return the claims about speed."""
    nanoseconds = results['batch_ns']
    vqf = nanoseconds['VQF updateBatch']
    found = [
        Verdict(f'{name} {preset}: part of VQF', nanoseconds[f'{name} {preset}'] / vqf, limit)
        for (name, preset), limit in LIMITS.items()
    ]
    factor = nanoseconds['filterpy, predict and update'] / nanoseconds['ahrs paper']
    found += [
        Verdict('AHRS: times faster than filterpy', factor, LEAST_OVER_FILTERPY, at_least=True),
        Verdict('12 h at 100 Hz, both filters', results['twelve_hours_s'], TWELVE_HOURS_S, 's'),
    ]
    for name, value in results.get('live', {}).items():
        found.append(Verdict(f'live, {name}: lost of {value["sent"]}', value['lost'], 0))
        if name.startswith('chain'):
            claim = f'live, {name}: p99 from driver to attitude'
            found.append(Verdict(claim, value['p99_ms'], CHAIN_P99_MS, 'ms'))
            claim = f'live, {name}: p99 from the stamp of the sample'
            found.append(Verdict(claim, value['from_stamp_p99_ms'], CHAIN_P99_MS, 'ms'))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--samples', type=int, default=400_000)
    parser.add_argument('--rounds', type=int, default=9)
    parser.add_argument('--live', type=float, default=0.0, metavar='SECONDS')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    results: dict[str, Any] = {
        'batch_ns': batch(options.samples, options.rounds),
        'twelve_hours_s': twelve_hours(),
        'update_us': one_update(),
    }
    if options.live:
        results['live'] = run_live(options.live)
    report(results)
    failed = judge([*verdicts(results), *static()])
    if options.json:
        options.json.write_text(json.dumps({**results, 'failed': failed}, indent=1) + '\n')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
