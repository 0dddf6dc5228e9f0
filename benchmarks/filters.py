# SPDX-License-Identifier: Apache-2.0
"""Speed of the orientation filters beside their peers: python benchmarks/filters.py [--json FILE].

Batch over 400 000 nine-axis samples at 100 Hz, every filter in turn, nine rounds, medians. CPU
time, so that other work on the machine counts less. All of our columns are returned (attitude,
covariance, bias, flags). Then 12 h at 100 Hz through both filters, and one update called from
Python. With --live SECONDS also a node at 1 kHz over DDS. Exit code 1 where a claim does not hold.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imufusion
import numpy as np
from filterpy.kalman import KalmanFilter
from imu_recording.jit import NUMBA
from orientation_filters.filters import FILTERS, filter_parameters, run_filter, state_bytes
from vqf import VQF

from imu_recording import ImuRecording
from orientation_filters import ahrs_filterpy

RATE_HZ = 100.0
PEER_SAMPLES = 20_000
"""For peers that are called sample by sample."""
FILTERPY_SAMPLES = 2_000
LIMITS = {
    ('complementary', 'paper'): 0.15,
    ('ahrs', 'paper'): 0.5,
    ('complementary', 'robust'): 0.3,
    ('ahrs', 'robust'): 0.75,
}
"""Largest part of VQF's batch time."""
LEAST_OVER_FILTERPY = 100.0
TWELVE_HOURS_S = 2.0


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
            lambda: ahrs_filterpy.run(short, filter_parameters('ahrs').kernel_params()),
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
        (int(stamp), tuple(w), tuple(f), tuple(m))
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
        state, _ = update(state, params, *rows[0])
        start = time.process_time()
        for row in rows[1:]:
            state, _ = update(state, params, *row)
        spent[f'{name} {preset}'] = (time.process_time() - start) / len(rows) * 1e6
    return spent


def live(seconds: float, rate_hz: float, *, raw: bool) -> dict[str, Any]:
    """Run ahrs_filter as a process fed at `rate_hz`; return losses and CPU per message."""
    code = Path(__file__).with_name('filters_live.py')
    arguments = [sys.executable, str(code), str(seconds), str(rate_hz), str(int(raw))]
    done = subprocess.run(arguments, capture_output=True, text=True, check=True)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


def report(results: dict[str, Any]) -> list[str]:
    """Print the results; return the claims that do not hold."""
    failed = []
    nanoseconds = results['batch_ns']
    vqf = nanoseconds['VQF updateBatch']
    print(f'{"":32}{"ns/sample":>11}{"of VQF":>9}{"limit":>8}')
    for name, value in nanoseconds.items():
        limit = LIMITS.get(tuple(name.split()))  # type: ignore[call-overload]
        shown = f'{limit:8.2f}' if limit else ''
        print(f'{name:32}{value:11.1f}{value / vqf:9.3f}{shown}')
        if limit and value > limit * vqf:
            failed.append(f'{name}: {value / vqf:.3f} of VQF, limit {limit}')
    factor = nanoseconds['filterpy, predict and update'] / nanoseconds['ahrs paper']
    print(f'AHRS against filterpy: {factor:.0f} × faster (at least {LEAST_OVER_FILTERPY:.0f})')
    if factor < LEAST_OVER_FILTERPY:
        failed.append(f'only {factor:.0f} × faster than filterpy')
    hours = results['twelve_hours_s']
    print(f'12 h at 100 Hz through both: {hours:.2f} s (at most {TWELVE_HOURS_S:g})')
    if hours > TWELVE_HOURS_S:
        failed.append(f'12 h take {hours:.2f} s')
    for name, value in results['update_us'].items():
        size = state_bytes(*name.split())
        print(f'one update of {name}: {value:.1f} µs, state {size} B')
    for name, value in results.get('live', {}).items():
        print(f'live {name}: {value}')
        if value['lost']:
            failed.append(f'live {name}: {value["lost"]} lost')
    return failed


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--samples', type=int, default=400_000)
    parser.add_argument('--rounds', type=int, default=9)
    parser.add_argument('--live', type=float, default=0.0, metavar='SECONDS')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    results: dict[str, Any] = {
        'compiled': NUMBA,
        'batch_ns': batch(options.samples, options.rounds),
        'twelve_hours_s': twelve_hours(),
        'update_us': one_update(),
    }
    if options.live:
        results['live'] = {
            f'1 kHz, {"raw" if raw else "typed"}': live(options.live, 1000.0, raw=raw)
            for raw in (False, True)
        }
    failed = report(results)
    if options.json:
        options.json.write_text(json.dumps({**results, 'failed': failed}, indent=1) + '\n')
    for line in failed:
        print(f'FAILED: {line}')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
