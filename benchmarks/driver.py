# SPDX-License-Identifier: Apache-2.0
"""The driver's claims, measured: python benchmarks/driver.py [--seconds 600] [--json FILE].

1. 952 Hz over a pseudo-terminal between two processes, with faults: every sample accounted for,
   CPU share of the node's process.
2. From the last byte of a frame to the return of publish, at 238 Hz.
3. Stamps against true sampling times through USB frames, jitter, stalls and a wandering crystal.
4. Soak: 1.3 million frames through the node as fast as it publishes; growth of its memory.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from driver_soak import EPOCH, soak
from imu_driver.board.clock import DeviceClock
from imu_driver.board.sample import Sample
from imu_driver.emulator.board import BoardOptions
from imu_driver.emulator.transport import emulated_board
from imu_driver.node import ImuDriverNode

PATIENCE = 60.0
"""[s] Processes may take so long to start on a busy machine."""
TICKS_PER_SECOND = os.sysconf('SC_CLK_TCK')


def cpu_seconds(process: int) -> float:
    fields = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_SECOND


def full_rate(seconds: float) -> dict[str, Any]:
    """Run emulator and node as processes; compare the node's counts with the emulator's log."""
    with tempfile.TemporaryDirectory() as folder:
        link, log = Path(folder) / 'imu0', Path(folder) / 'sent.json'
        third = seconds / 3.0
        faults = [f'--fault=bit_flips@{third:g}+5', f'--fault=drop_bytes@{2 * third:g}+5']
        emulator = subprocess.Popen(
            [
                _executable('emulated_device'),
                *('--link', str(link), '--log', str(log), '--rate', '952', *faults),
            ]
        )
        while not link.is_symlink():
            if emulator.poll() is not None:
                raise SystemExit(f'emulated_device ended with {emulator.returncode}')
            time.sleep(0.05)
        node = subprocess.Popen(
            [_executable('imu_driver_node'), '--ros-args', '-p', f'transport:=serial://{link}'],
            stderr=subprocess.DEVNULL,
        )
        counts: dict[str, str] = {}
        rclpy.init()
        listener = rclpy.create_node('benchmark')
        listener.create_subscription(
            DiagnosticArray, '/diagnostics', lambda message: counts.update(_values(message)), 10
        )
        try:
            _spin(listener, 5.0)
            before, began = cpu_seconds(node.pid), time.monotonic()
            _spin(listener, seconds - 5.0)
            share = (cpu_seconds(node.pid) - before) / (time.monotonic() - began)
            emulator.send_signal(signal.SIGTERM)
            emulator.wait()
            _spin(listener, 2.5)
            sent = json.loads(log.read_text())
        finally:
            for process in (emulator, node):
                process.terminate()
                process.wait()
            listener.destroy_node()
            rclpy.try_shutdown()
    received, lost = int(counts['samples_received']), int(counts['samples_lost'])
    return {
        'sent': sent['sent'],
        'received': received,
        'lost': lost,
        'damaged': len(sent['damaged']),
        'dropped': sent['dropped'],
        'accounted': received + lost == sent['sent'],
        'cpu_share': share,
    }


def _executable(name: str) -> str:
    prefix = Path(sys.prefix).parent / 'install' / 'imu_driver' / 'lib' / 'imu_driver' / name
    return str(prefix)


def _values(message: DiagnosticArray) -> dict[str, str]:
    (status,) = message.status
    if not status.name.endswith('imu_driver'):
        return {}
    return {value.key: value.value for value in status.values}


def _spin(node: Any, seconds: float) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.2)


def latency(seconds: float, rate: float = 238.0) -> dict[str, float]:
    """Time from a frame's last byte on the terminal to the end of its publication."""
    board, host = os.openpty()
    tty.setraw(host)
    published: list[float] = []

    class Watched(ImuDriverNode):
        def publish(self, samples: list[Sample]) -> None:
            super().publish(samples)
            published.extend([time.monotonic()] * len(samples))

    writer = subprocess.Popen(
        [sys.executable, __file__, '--write-frames', str(board), str(rate), str(seconds)],
        pass_fds=(board,),
        stdout=subprocess.PIPE,
        text=True,
    )
    sys.setswitchinterval(5e-4)  # as the node's own main does
    rclpy.init()
    node = Watched(parameters={'transport': f'serial://{os.ttyname(host)}'})
    node.autostart()
    give_up = time.monotonic() + PATIENCE
    while not published and time.monotonic() < give_up:
        rclpy.spin_once(node, timeout_sec=0.1)
    _spin(node, seconds + 1.0)
    lost = node.driver.session.sequence.lost
    node.trigger_deactivate()
    node.destroy_node()
    rclpy.try_shutdown()
    written = [float(line) for line in writer.communicate()[0].split()]
    os.close(board)
    os.close(host)
    if lost:
        raise RuntimeError(f'{lost} samples were lost: the two lists do not match')
    count = min(len(published), len(written))
    late = np.array(published[:count]) - np.array(written[:count])
    late = late[round(rate) :]  # the first second waits for the device's identity
    return {
        'samples': len(late),
        'p50_ms': float(np.percentile(late, 50)) * 1e3,
        'p99_ms': float(np.percentile(late, 99)) * 1e3,
        'largest_ms': float(late.max()) * 1e3,
    }


def write_frames(handle: int, rate: float, seconds: float) -> None:
    """Act as a board on a terminal; print when each data frame's last byte was written."""
    board = emulated_board('dut1', BoardOptions(output_data_rate=rate))
    os.set_blocking(handle, False)
    start = time.monotonic()
    times: list[float] = []
    while time.monotonic() < (times[0] + seconds if times else start + PATIENCE):
        time.sleep(max(board.next_due - (time.monotonic() - start), 0.0))
        with contextlib.suppress(BlockingIOError):
            board.receive(os.read(handle, 4096), time.monotonic() - start)
        for sent in board.advance(time.monotonic() - start):
            os.write(handle, sent.data)
            if sent.sample >= 0:
                times.append(time.monotonic())
    print('\n'.join(map(repr, times)))


def stamps(hours: float = 1.0, rate: float = 238.0, seed: int = 1) -> dict[str, float]:
    """Error of stamps over an hour of everything that delays samples."""
    rng = np.random.default_rng(seed)
    true = np.arange(int(hours * 3600 * rate)) / rate
    period = 3600.0
    device = true * (1 + 35e-6) + 8e-6 * period / (2 * np.pi) * (
        1 - np.cos(2 * np.pi * true / period)
    )
    arrival = true + 0.3e-3 + rng.exponential(0.5e-3, len(true))
    arrival = np.ceil(arrival * 1e3) * 1e-3
    for stall in rng.uniform(0.0, true[-1], int(true[-1] / 2)):
        arrival[(arrival > stall) & (arrival < stall + 0.02)] = stall + 0.02
    arrival = np.maximum.accumulate(arrival)
    clock = DeviceClock()
    ticks = (device * 1e6).astype(np.int64) % (1 << 32)
    nanoseconds = (arrival * 1e9).astype(np.int64) + EPOCH
    began = time.perf_counter()
    out = np.array(
        [
            clock.stamp(tick, at)
            for tick, at in zip(ticks.tolist(), nanoseconds.tolist(), strict=True)
        ]
    )
    took = time.perf_counter() - began
    error = (out - EPOCH) * 1e-9 - true
    return {
        'std_us': float(error.std()) * 1e6,
        'p99.9_us': float(np.percentile(np.abs(error - error.mean()), 99.9)) * 1e6,
        'arrival_std_us': float((arrival - true).std()) * 1e6,
        'backward_steps': int((np.diff(out) <= 0).sum()),
        'us_per_sample': took / len(true) * 1e6,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=600.0, help='of the full-rate run')
    parser.add_argument('--frames', type=int, default=1_300_000, help='of the soak')
    parser.add_argument('--json', type=Path)
    parser.add_argument('--write-frames', nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.write_frames:
        handle, rate, seconds = options.write_frames
        write_frames(int(handle), float(rate), float(seconds))
        return 0
    results: dict[str, dict[str, Any]] = {}
    for name, measure in (
        ('stamps', stamps),
        ('latency at 238 Hz', lambda: latency(20.0)),
        ('soak', lambda: soak(options.frames)),
        (f'952 Hz for {options.seconds:g} s', lambda: full_rate(options.seconds)),
    ):
        print(name, '…', flush=True)
        results[name] = measure()
        for key, value in results[name].items():
            print(f'  {key:20} {value:.4g}' if isinstance(value, float) else f'  {key:20} {value}')
    full = results[f'952 Hz for {options.seconds:g} s']
    met = {
        'stamps within 50 µs': results['stamps']['std_us'] <= 50,
        'p99 within 5 ms': results['latency at 238 Hz']['p99_ms'] <= 5,
        'growth within 5 MB': results['soak']['growth_mb'] <= 5,
        'every sample accounted for': full['accounted'],
        'at most 35 % of a core': full['cpu_share'] <= 0.35,
    }
    for claim, holds in met.items():
        print(f'{"met    " if holds else "NOT MET"} {claim}')
    if options.json:
        options.json.write_text(json.dumps({'results': results, 'met': met}, indent=1) + '\n')
    return 0 if all(met.values()) else 1


if __name__ == '__main__':
    sys.exit(main())
