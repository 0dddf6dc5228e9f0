# SPDX-License-Identifier: Apache-2.0
"""Reading a bag, against rosbags: python benchmarks/reader.py [--messages N] [--json FILE].

read_bag of a whole recording (Imu, MagneticField and Temperature in equal numbers) and rosbags'
AnyReader with deserialize, in turns in one process; the peer reads the first 150 000 messages of
the same file, its time is scaled to all of them, opening counted once. One warm-up, then medians
of five rounds, per message; the first numbers of both are compared. The sqlite3 file is also read
row by row through Python's `sqlite3`, as damaged files are. `--memory` adds the peak memory of
reading 12 h at 100 Hz, in a process of its own.
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
from unittest.mock import patch

import numpy as np
from rosbags.highlevel import AnyReader

from imu_recording import ImuRecording, read_bag, write_bag

FORMATS = {
    'mcap': ('mcap', 'none', 50.0),
    'mcap zstd': ('mcap', 'zstd', 30.0),
    'sqlite3': ('sqlite3', 'none', 8.0),
}
"""Storage, compression, and the ratio claimed."""
ROUNDS = 5
PEER_MESSAGES = 150_000
START = 1_700_000_000_000_000_000
COLD = """
import sys, time
begin = time.perf_counter()
from imu_recording import read_bag
read_bag(sys.argv[1])
print(time.perf_counter() - begin)
"""
PEAK = """
import sys
from pathlib import Path
from imu_recording import read_bag

def status(key):
    lines = Path('/proc/self/status').read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith(key))

read_bag(sys.argv[2])  # loads the kernels
imported = status('VmRSS')
Path('/proc/self/clear_refs').write_text('5')  # restarts the high-water mark
recording = read_bag(sys.argv[1])
arrays = [v.nbytes for v in vars(recording).values() if hasattr(v, 'nbytes')]
print(len(recording), sum(arrays), status('VmHWM') - imported)
"""


def make_recording(rows: int) -> ImuRecording:
    """Counts of a 16-bit device with noise, 100 Hz."""
    rng = np.random.default_rng(1)

    def counts(deviation: float, scale: float, width: int) -> Any:
        return np.rint(rng.normal(0, deviation, (rows, width))) * scale

    return ImuRecording(
        stamp=START + 10_000_000 * np.arange(rows),
        angular_velocity=counts(50, 1.5e-4, 3),
        linear_acceleration=counts(30, 6e-4, 3) + [0.0, 0.0, 9.8],
        magnetic_field=counts(10, 1.4e-8, 3),
        temperature=25 + counts(10, 1 / 16, 1)[:, 0],
    )


def peer_seconds_per_message(path: Path, limit: int, total: int) -> float:
    """AnyReader with deserialize on the first messages, scaled to all; opening counts once."""
    begin = time.perf_counter()
    with AnyReader([path]) as reader:
        opened = time.perf_counter()
        count = 0
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            count += 1
            if count == limit:
                break
        done = time.perf_counter()
    return (done - opened) / count + (opened - begin) / total


def check_same(path: Path, recording: ImuRecording) -> None:
    """Compare the first numbers of both readers."""
    rates: list[Any] = []
    temperatures: list[float] = []
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            if connection.topic.endswith('data_raw'):
                rate = message.angular_velocity
                rates.append((rate.x, rate.y, rate.z))
            elif connection.topic.endswith('temperature'):
                temperatures.append(message.temperature)
            if len(rates) == 1000:
                break
    same = np.array_equal(recording.angular_velocity[:1000], rates) and np.array_equal(
        recording.temperature[: len(temperatures)], temperatures
    )
    if not same:
        raise SystemExit(f'{path}: the two readers differ')


def seconds(act: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    act()
    return time.perf_counter() - begin


def compare(path: Path, rows: int) -> dict[str, float]:
    """Take both readers in turns."""
    total = 3 * rows
    check_same(path, read_bag(path))
    peer_seconds_per_message(path, PEER_MESSAGES, total)
    ours, peers = [], []
    for _ in range(ROUNDS):
        ours.append(seconds(lambda: read_bag(path)) / total)
        peers.append(peer_seconds_per_message(path, PEER_MESSAGES, total))
    cold = subprocess.run(
        [sys.executable, '-c', COLD, str(path)], capture_output=True, text=True, check=True
    )
    return {
        'nanoseconds_per_message': 1e9 * statistics.median(ours),
        'peer_nanoseconds_per_message': 1e9 * statistics.median(peers),
        'ratio': statistics.median(peers) / statistics.median(ours),
        'ratio_lowest_round': min(p / o for p, o in zip(peers, ours, strict=True)),
        'seconds': total * statistics.median(ours),
        'cold_process_seconds': float(cold.stdout),
    }


def by_rows(path: Path, rows: int) -> float:
    """Return the time to read a sqlite3 file without its page reader [s per message]."""
    with patch('imu_recording.bags.sqlite.scan_pages', lambda *_: -1):
        return statistics.median(seconds(lambda: read_bag(path)) for _ in range(ROUNDS)) / (
            3 * rows
        )


def peak_memory(folder: Path) -> dict[str, float]:
    """Peak above the imported process of reading 12 h at 100 Hz, against the arrays returned."""
    rows = 12 * 3600 * 100
    small = folder / 'small'
    write_bag(make_recording(1000), small)
    code = (
        f'import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import reader; '
        f'reader.write_bag(reader.make_recording({rows}), {str(folder / "long")!r})'
    )
    subprocess.run([sys.executable, '-c', code], check=True)
    done = subprocess.run(
        [sys.executable, '-c', PEAK, str(folder / 'long'), str(small)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    samples, returned, peak = map(int, done.stdout.split())
    return {
        'samples': samples,
        'returned_bytes': returned,
        'peak_bytes': peak,
        'peak_over_returned': peak / returned,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--messages', type=int, default=2_000_000)
    parser.add_argument('--memory', action='store_true', help='peak memory of 12 h at 100 Hz')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    rows = -(-options.messages // 3)
    answer: dict[str, Any] = {'schema': 1, 'messages': 3 * rows, 'formats': {}}
    with tempfile.TemporaryDirectory() as folder:
        recording = make_recording(rows)
        print(f'{3 * rows} messages; medians of {ROUNDS}; peer: rosbags AnyReader + deserialize')
        for name, (storage, compression, claim) in FORMATS.items():
            path = Path(folder) / name.replace(' ', '_')
            took = seconds(
                lambda p=path, s=storage, c=compression: write_bag(
                    recording, p, storage=s, compression=c
                )
            )
            result = compare(path, rows) | {'claim': claim, 'write_seconds': took}
            if storage == 'sqlite3':
                result['by_rows_nanoseconds_per_message'] = 1e9 * by_rows(path, rows)
            answer['formats'][name] = result
            print(
                f'{name:10} {result["ratio"]:6.1f} × (claim ≥ {claim:g}, lowest round '
                f'{result["ratio_lowest_round"]:.1f}); {result["nanoseconds_per_message"]:.0f} '
                f'against {result["peer_nanoseconds_per_message"]:.0f} ns per message; '
                f'{result["seconds"]:.2f} s, cold process {result["cold_process_seconds"]:.2f} s; '
                f'written in {took:.1f} s'
            )
            if storage == 'sqlite3':
                rowwise = result['by_rows_nanoseconds_per_message']
                print(f'{name:10} row by row {rowwise:.0f} ns per message')
        if options.memory:
            answer['memory'] = peak_memory(Path(folder))
            print(
                f'12 h at 100 Hz: peak {answer["memory"]["peak_over_returned"]:.2f} × the '
                f'{answer["memory"]["returned_bytes"] / 1e6:.0f} MB returned (claim ≤ 3)'
            )
    if options.json:
        options.json.write_text(json.dumps(answer, indent=1) + '\n')


if __name__ == '__main__':
    main()
