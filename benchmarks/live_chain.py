# SPDX-License-Identifier: Apache-2.0
"""The chain in one process beside separate ones: python benchmarks/live_chain.py [--seconds 20].

Driver, compensation and AHRS, each kind at the same rates, pinned to one core; the board, emulated
on a pseudo-terminal, and the listener on another: CPU time of the processes, time from a sample's
stamp to the receipt of its orientation, samples lost on the way. `floor` only counts what comes
on the line and sends as many messages (live_floor.py): what is left for a chain in Python to
save lies above it. Then with nothing subscribed but the orientation, with a recorder as a stage,
a recorder and a filter by themselves, the filter by bytes as it is and by message objects
(live_typed.py). `--board inside` simulates the board in the driver's
process, which then pays for it. `--soak 600` runs the chain for so many seconds and counts what
is lost. One line for each claim at the end; exit code 1 where one does not hold.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from imu_recording.ros.sample_bytes import imu_from_bytes
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, MagneticField, Temperature

FLOOR = Path(__file__).with_name('live_floor.py')
TYPED = Path(__file__).with_name('live_typed.py')
BAGS = Path(__file__).resolve().parents[1] / 'bags'
TICKS = os.sysconf('SC_CLK_TCK')
CORES = sorted(os.sched_getaffinity(0))
WARM_UP = 3.0
"""[s] between the first orientation and the measurement."""
PATIENCE = 90.0
"""[s] for the first orientation."""
OUTPUTS = {
    'imu/data_raw': Imu,
    'imu/mag': MagneticField,
    'imu/temperature': Temperature,
    'imu_compensated/data_raw': Imu,
    'imu_compensated/mag': MagneticField,
    'imu/data': Imu,
}
COMPENSATED = (
    '-r',
    'imu/data_raw:=imu_compensated/data_raw',
    '-r',
    'imu/mag:=imu_compensated/mag',
)


def start(package: str, name: str, parameters: dict[str, Any], *more: str) -> Any:
    executable = Path(get_package_prefix(package)) / 'lib' / package / name
    given = [word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
    return pinned(str(executable), '--ros-args', *given, *more)


def pinned(*words: str) -> Any:
    """Start a process on the last core."""
    child = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    os.sched_setaffinity(child.pid, {CORES[-1]})  # and so its threads, when they begin
    return child


@dataclass(frozen=True)
class Wanted:
    """What is started: a board and its rate, a model, a bag."""

    transport: str
    rate: float
    model: Path
    record: Path | None

    @property
    def source(self) -> dict[str, Any]:
        """Parameters of the driver."""
        return {'transport': self.transport, 'output_data_rate': self.rate}


def emulated_board(link: Path, rate: float) -> Any:
    """Start a board on a pseudo-terminal, beside the listener."""
    executable = Path(get_package_prefix('imu_driver')) / 'lib/imu_driver/emulated_device'
    words = [str(executable), '--link', str(link), '--rate', str(rate)]
    child = subprocess.Popen(words, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    give_up = time.monotonic() + PATIENCE
    while not link.exists() and time.monotonic() < give_up:
        time.sleep(0.05)
    return child


def separate(wanted: Wanted) -> list[Any]:
    """Start a process for each stage, the driver last."""
    children = [
        start('thermal_comp', 'thermal_comp_node', {'model': wanted.model}),
        start('orientation_filters', 'ahrs_filter_node', {'publish_euler': 'false'}, *COMPENSATED),
    ]
    if wanted.record:
        children.append(start('imu_recording', 'recorder_node', {'output': wanted.record}))
    time.sleep(WARM_UP)
    return [*children, start('imu_driver', 'imu_driver_node', wanted.source)]


def together(wanted: Wanted) -> list[Any]:
    """Start the chain."""
    record = {'record': wanted.record} if wanted.record else {}
    given = {'model': wanted.model, 'filter': 'ahrs', 'publish_euler': 'false', **record}
    return [start('imu_bringup', 'imu_chain_node', {**wanted.source, **given})]


def one_filter(wanted: Wanted) -> list[Any]:
    """Start a filter and its driver; the first alone is measured."""
    child = start('orientation_filters', 'ahrs_filter_node', {'publish_euler': 'false'})
    time.sleep(WARM_UP)
    return [child, start('imu_driver', 'imu_driver_node', wanted.source)]


def typed_filter(wanted: Wanted) -> list[Any]:
    """Start a filter that hears message objects, and its driver; the first alone is measured."""
    child = pinned(sys.executable, str(TYPED), '--ros-args', '-p', 'publish_euler:=false')
    time.sleep(WARM_UP)
    return [child, start('imu_driver', 'imu_driver_node', wanted.source)]


def floor(wanted: Wanted) -> list[Any]:
    """Start what sends as many messages as the chain and computes nothing; on a line alone."""
    link = wanted.transport.removeprefix('serial://')
    return [pinned(sys.executable, str(FLOOR), link, str(wanted.rate))]


def recorder_alone(wanted: Wanted) -> list[Any]:
    """Start a recorder and, in a process of its own, the chain; the first alone is measured."""
    child = start('imu_recording', 'recorder_node', {'output': wanted.record})
    time.sleep(WARM_UP)
    given = {'model': wanted.model, 'filter': 'ahrs', 'publish_euler': 'false'}
    return [child, start('imu_bringup', 'imu_chain_node', {**wanted.source, **given})]


ALONE = (one_filter, typed_filter, recorder_alone)
"""Of which the first process alone is measured."""


class Listener:
    """Stamp → time of receipt [ns] of the first and the last of the Imu topics."""

    def __init__(self, outputs: list[str]) -> None:
        self.at: dict[str, dict[int, int]] = {topic: {} for topic in ('imu/data_raw', 'imu/data')}
        self.node = rclpy.create_node('live_chain')
        for topic in outputs:
            take = self._noting(self.at[topic]) if topic in self.at else self._ignore
            qos = QoSProfile(depth=5000)
            self.node.create_subscription(OUTPUTS[topic], topic, take, qos, raw=True)
        executor = EventsExecutor()
        executor.add_node(self.node)
        self._open = True
        self._thread = threading.Thread(target=self._spin, args=(executor,), daemon=True)
        self._thread.start()

    def _spin(self, executor: EventsExecutor) -> None:
        while self._open:
            executor.spin_once(timeout_sec=0.1)

    @staticmethod
    def _noting(at: dict[int, int]) -> Any:
        def note(data: bytes) -> None:
            at[imu_from_bytes(data).stamp] = time.time_ns()

        return note

    def _ignore(self, data: bytes) -> None:
        """Receive what only has to be sent."""

    def close(self) -> None:
        self._open = False
        self._thread.join()
        self.node.destroy_node()


def cpu_seconds(process: int) -> float:
    fields = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def lost_samples(stamps: list[int]) -> int:
    """Return how many are missing in a series of stamps [ns] of a nearly constant interval."""
    intervals = np.diff(np.sort(stamps))
    return int(np.sum(np.round(intervals / np.median(intervals)) - 1))


def measure(begin: Any, wanted: Wanted, seconds: float, outputs: list[str]) -> dict[str, float]:
    """Return CPU (share of a core, per sample), latency and losses of one configuration."""
    listener = Listener(outputs)
    serial = wanted.transport.startswith('serial://')
    link = Path(wanted.transport.removeprefix('serial://'))
    boards = [emulated_board(link, wanted.rate)] if serial else []
    children = begin(wanted)
    measured = children[:1] if begin in ALONE else children
    try:
        done, give_up = listener.at['imu/data'], time.monotonic() + PATIENCE
        while not done and time.monotonic() < give_up:
            time.sleep(0.1)
        time.sleep(WARM_UP)
        first, before = max(done), [cpu_seconds(child.pid) for child in measured]
        began = time.monotonic()
        time.sleep(seconds)
        spent = [cpu_seconds(c.pid) - b for c, b in zip(measured, before, strict=True)]
        took = time.monotonic() - began
        last = max(done)
    finally:
        for child in [*children, *boards]:
            child.terminate()
        for child in [*children, *boards]:
            child.wait()
        listener.close()
    stamps = [stamp for stamp in done if first < stamp <= last]
    latency = [(done[stamp] - stamp) * 1e-6 for stamp in stamps]
    return {
        'cpu': sum(spent) / took,
        'us_per_sample': sum(spent) / len(stamps) * 1e6,
        'samples': len(stamps),
        'lost': lost_samples(stamps),
        'p50_ms': float(np.percentile(latency, 50)),
        'p99_ms': float(np.percentile(latency, 99)),
        **{f'cpu_{Path(c.args[0]).stem}': s / took for c, s in zip(measured, spent, strict=True)},
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=20.0, help='of each measurement')
    parser.add_argument('--only', default='', help='measure configurations that hold this word')
    parser.add_argument(
        '--board', choices=('line', 'inside'), default='line', help='where it is emulated'
    )
    parser.add_argument('--soak', type=float, help='[s] of the chain alone, for what it loses')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    everything, result_only = list(OUTPUTS), ['imu/data']
    configurations = {
        'separate, 238 Hz': (separate, 238.0, everything, False),
        'chain, 238 Hz': (together, 238.0, everything, False),
        'floor, 238 Hz': (floor, 238.0, everything, False),
        'chain, 952 Hz': (together, 952.0, everything, False),
        'chain, 952 Hz, orientation alone': (together, 952.0, result_only, False),
        'chain, 952 Hz, orientation alone, recorder': (together, 952.0, result_only, True),
        'recorder, 952 Hz': (recorder_alone, 952.0, result_only, True),
        'one filter, 952 Hz': (one_filter, 952.0, result_only, False),
        'one filter by typed messages, 952 Hz': (typed_filter, 952.0, result_only, False),
    }
    if options.board == 'inside':  # the floor has no board of its own
        del configurations['floor, 238 Hz']
    if options.soak:
        options.seconds = options.soak
        configurations = {'chain, 238 Hz': configurations['chain, 238 Hz']}
    results: dict[str, dict[str, float]] = {}
    os.sched_setaffinity(0, CORES[:-1] or CORES)
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / 'dut1.yaml'
        bags = [str(BAGS / f'dut1_{axis}') for axis in 'xyz']
        fit = [sys.executable, '-m', 'imu_workbench', 'fit', *bags, '-o', str(model)]
        subprocess.run(fit, check=True, capture_output=True)
        for name, (begin, rate, outputs, records) in configurations.items():
            if options.only not in name:
                continue
            bag = Path(folder) / f'bag_{len(results)}' if records else None
            link = f'serial://{folder}/imu'
            transport = link if options.board == 'line' else 'simulated://dut1'
            wanted = Wanted(transport, rate, model, bag)
            results[name] = measure(begin, wanted, options.seconds, outputs)
            if begin is floor:  # it stamps at receipt: no interval tells of a loss
                del results[name]['lost']
            told = {key: round(value, 3) for key, value in results[name].items()}
            print(name, *(f'{key} {value:g}' for key, value in told.items()), sep='  ', flush=True)
    rclpy.try_shutdown()
    met = claims(results)
    for claim, holds in met.items():
        print(f'{"met    " if holds else "NOT MET"} {claim}')
    if options.json:
        options.json.write_text(json.dumps({'results': results, 'met': met}, indent=1) + '\n')
    return 0 if all(met.values()) else 1


def claims(results: dict[str, dict[str, float]]) -> dict[str, bool]:
    """Return each claim on what was measured, and whether it holds."""
    limits = {
        'chain, 238 Hz': 0.14,
        'chain, 952 Hz': 0.45,
        'chain, 952 Hz, orientation alone': 0.30,
        'recorder, 952 Hz': 0.50,
    }
    met = {
        f'{name}: at most {limit:.0%} of a core': results[name]['cpu'] <= limit
        for name, limit in limits.items()
        if name in results
    }
    without = 'chain, 952 Hz, orientation alone'
    with_recorder = f'{without}, recorder'
    if {without, with_recorder} <= results.keys():
        stage = results[with_recorder]['cpu'] - results[without]['cpu']
        met[f'recorder as a stage: at most 25% of a core ({stage:.0%})'] = stage <= 0.25
    if {'separate, 238 Hz', 'chain, 238 Hz'} <= results.keys():
        share = results['chain, 238 Hz']['cpu'] / results['separate, 238 Hz']['cpu']
        met[f'a quarter of separate processes ({share:.2f})'] = share <= 0.25
    if {'separate, 238 Hz', 'floor, 238 Hz'} <= results.keys():
        share = results['floor, 238 Hz']['cpu'] / results['separate, 238 Hz']['cpu']
        print(f'floor: {share:.2f} of separate processes, nothing computed')
    for name, most in (('one filter', 200.0), ('one filter by typed messages', 300.0)):
        if f'{name}, 952 Hz' in results:
            cost = results[f'{name}, 952 Hz']['us_per_sample']
            met[f'{name}: at most {most:g} µs a sample ({cost:.0f})'] = cost <= most
    if 'chain, 238 Hz' in results:
        met['p99 within 3 ms'] = results['chain, 238 Hz']['p99_ms'] <= 3.0
    met['nothing lost'] = not any(found.get('lost') for found in results.values())
    return met


if __name__ == '__main__':
    sys.exit(main())
