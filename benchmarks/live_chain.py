# SPDX-License-Identifier: Apache-2.0
"""The chain in one process beside separate ones: python benchmarks/live_chain.py [--seconds 20].

Driver (simulated://dut1), compensation and AHRS, each kind at the same rates, pinned to one
core, the listener on another: CPU time of the processes, time from a sample's stamp to the receipt
of its orientation, samples lost on the way. Then with a recorder, and with nothing subscribed but
the orientation. One line for each claim at the end; exit code 1 where one does not hold.
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
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from imu_recording.ros.sample_bytes import imu_from_bytes
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, MagneticField, Temperature

BAGS = Path(__file__).resolve().parents[1] / 'bags'
TICKS = os.sysconf('SC_CLK_TCK')
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
    return subprocess.Popen(
        [str(executable), '--ros-args', *given, *more], stderr=subprocess.DEVNULL
    )


def separate(rate: float, model: Path, record: Path | None) -> list[Any]:
    """Start a process for each stage, the driver last."""
    children = [
        start('thermal_comp', 'thermal_comp_node', {'model': model}),
        start('orientation_filters', 'ahrs_filter_node', {'publish_euler': 'false'}, *COMPENSATED),
    ]
    if record:
        children.append(start('imu_recording', 'recorder_node', {'output': record}))
    time.sleep(WARM_UP)
    given = {'transport': 'simulated://dut1', 'output_data_rate': rate}
    return [*children, start('imu_driver', 'imu_driver_node', given)]


def together(rate: float, model: Path, record: Path | None) -> list[Any]:
    """Start the chain."""
    given = {
        'transport': 'simulated://dut1', 'output_data_rate': rate, 'model': model,
        'filter': 'ahrs', 'publish_euler': 'false', **({'record': record} if record else {}),
    }  # fmt: skip
    return [start('imu_bringup', 'imu_chain_node', given)]


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


def measure(
    begin: Any, rate: float, seconds: float, model: Path, outputs: list[str], record: Path | None
) -> dict[str, float]:
    """Return CPU (share of a core, per sample), latency and losses of one configuration."""
    listener = Listener(outputs)
    children = begin(rate, model, record)
    try:
        cores = sorted(os.sched_getaffinity(0))
        for child in children:
            for thread in Path(f'/proc/{child.pid}/task').iterdir():
                os.sched_setaffinity(int(thread.name), {cores[-1]})
        done, give_up = listener.at['imu/data'], time.monotonic() + PATIENCE
        while not done and time.monotonic() < give_up:
            time.sleep(0.1)
        time.sleep(WARM_UP)
        first, before = max(done), [cpu_seconds(child.pid) for child in children]
        began = time.monotonic()
        time.sleep(seconds)
        spent = [cpu_seconds(c.pid) - b for c, b in zip(children, before, strict=True)]
        took = time.monotonic() - began
        last = max(done)
    finally:
        for child in children:
            child.terminate()
        for child in children:
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
        **{f'cpu_{Path(c.args[0]).stem}': s / took for c, s in zip(children, spent, strict=True)},
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seconds', type=float, default=20.0, help='of each measurement')
    parser.add_argument('--only', default='', help='measure configurations that hold this word')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    everything, result_only = list(OUTPUTS), ['imu/data']
    configurations = {
        'separate, 238 Hz': (separate, 238.0, everything, False),
        'chain, 238 Hz': (together, 238.0, everything, False),
        'chain, 952 Hz': (together, 952.0, everything, False),
        'chain, 952 Hz, orientation alone': (together, 952.0, result_only, False),
        'chain, 952 Hz, orientation alone, recorder': (together, 952.0, result_only, True),
    }
    results: dict[str, dict[str, float]] = {}
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / 'dut1.yaml'
        bags = [str(BAGS / f'dut1_{axis}') for axis in 'xyz']
        fit = [sys.executable, '-m', 'imu_workbench', 'fit', *bags, '-o', str(model)]
        subprocess.run(fit, check=True, capture_output=True)
        for name, (begin, rate, outputs, records) in configurations.items():
            if options.only not in name:
                continue
            bag = Path(folder) / 'bag' if records else None
            results[name] = measure(begin, rate, options.seconds, model, outputs, bag)
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
        'chain, 952 Hz, orientation alone, recorder': 0.55,
    }
    met = {
        f'{name}: at most {limit:.0%} of a core': results[name]['cpu'] <= limit
        for name, limit in limits.items()
        if name in results
    }
    if {'separate, 238 Hz', 'chain, 238 Hz'} <= results.keys():
        share = results['chain, 238 Hz']['cpu'] / results['separate, 238 Hz']['cpu']
        met[f'a quarter of separate processes ({share:.2f})'] = share <= 0.25
    if 'chain, 238 Hz' in results:
        met['p99 within 3 ms'] = results['chain, 238 Hz']['p99_ms'] <= 3.0
    met['nothing lost'] = not any(found['lost'] for found in results.values())
    return met


if __name__ == '__main__':
    sys.exit(main())
