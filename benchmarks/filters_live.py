# SPDX-License-Identifier: Apache-2.0
"""Filters as processes over DDS: losses, latency and CPU per message; run by filters.py.

python benchmarks/filters_live.py node SECONDS RATE_HZ feeds an ahrs_filter;
python benchmarks/filters_live.py chain SECONDS MODEL runs driver, compensation and filter.
Each prints one JSON line.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from ament_index_python.packages import get_package_prefix
from imu_recording.ros.messages import (
    ImuSample,
    MagneticSample,
    imu_from_sample,
    magnetic_field_from_sample,
    stamp_of,
)
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, MagneticField

BATCH_S = 0.005
"""Messages are due on their own clock and sent in bursts of this length."""
SETTLED = 500
"""Messages after which the chain is measured."""
QOS = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)
TICKS = os.sysconf('SC_CLK_TCK')


def cpu_seconds(process: int) -> float:
    fields = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def wait_until(done: Callable[[], bool], children: Sequence[subprocess.Popen[bytes]]) -> None:
    """Wait for what the children bring about; end with them if one of them ends."""
    while not done():
        for child in children:
            if child.poll() is not None:
                for other in children:
                    other.terminate()
                raise SystemExit(f'{child.args} ended with {child.returncode}')
        time.sleep(0.1)


def feed(out: Publisher, out_field: Publisher, count: int, rate_hz: float) -> None:
    """Send `count` pairs of messages, each stamped when it is sent."""
    start, sent = time.time_ns(), 0
    while sent < count:
        due = min(count, int((time.time_ns() - start) * 1e-9 * rate_hz))
        while sent < due:
            stamp = time.time_ns()
            imu = ImuSample(stamp, (0.0, 0.0, 0.1), (0.0, 0.0, 9.81))
            field = MagneticSample(stamp, (2e-5, 0.0, -4e-5))
            out_field.publish(magnetic_field_from_sample(field))
            out.publish(imu_from_sample(imu))
            sent += 1
        time.sleep(BATCH_S)


def one_node(seconds: float, rate_hz: float) -> dict[str, Any]:
    """Feed an ahrs_filter; return losses, CPU per message and latency from stamp to receipt."""
    child = start('orientation_filters', 'ahrs_filter_node', ['publish_euler:=false'])
    rclpy.init()
    node = rclpy.create_node('filters_live')
    out = node.create_publisher(Imu, 'imu/data_raw', QOS)
    out_field = node.create_publisher(MagneticField, 'imu/mag', QOS)
    seen = Arrivals(node, 'imu/data')
    spinner = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
    spinner.start()
    wait_until(
        lambda: bool(node.count_subscribers('imu/data_raw') and node.count_publishers('imu/data')),
        [child],
    )
    time.sleep(1.0)
    count = round(seconds * rate_hz)
    before = cpu_seconds(child.pid)
    feed(out, out_field, count, rate_hz)
    deadline = time.monotonic() + 5.0
    while len(seen.at) < count and time.monotonic() < deadline:
        time.sleep(0.05)
    spent = cpu_seconds(child.pid) - before
    stop([child], spinner)
    milliseconds = [(at - stamp) * 1e-6 for stamp, at in seen.at.items()]
    return {
        'sent': count,
        'lost': count - len(seen.at),
        'cpu_us_per_message': round(spent / count * 1e6, 1),
        **percentiles(milliseconds),
    }


def chain(seconds: float, model: str) -> dict[str, Any]:
    """Run driver (238 Hz), compensation and filter; return losses and latencies behind the driver.

    p50_ms, p99_ms: from the receipt of imu/data_raw to that of imu/data, both by the same
    subscriber; from_stamp_p99_ms: from the sample's stamp, the driver's share included.
    """
    moved = ['imu/data_raw:=imu_compensated/data_raw', 'imu/mag:=imu_compensated/mag']
    children = [
        start('thermal_comp', 'thermal_comp_node', [f'model:={model}']),
        start('orientation_filters', 'ahrs_filter_node', ['publish_euler:=false'], moved),
    ]
    rclpy.init()
    node = rclpy.create_node('filters_live')
    raw, done = Arrivals(node, 'imu/data_raw'), Arrivals(node, 'imu/data')
    spinner = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
    spinner.start()
    wait_until(
        lambda: bool(
            node.count_subscribers('imu_compensated/data_raw')
            and node.count_publishers('imu/data')
        ),
        children,
    )
    options = ['transport:=simulated://dut1', 'output_data_rate:=238']
    children.append(start('imu_driver', 'imu_driver_node', options))
    wait_until(lambda: len(done.at) >= SETTLED, children)
    first = max(done.at)
    before = [cpu_seconds(child.pid) for child in children]
    time.sleep(seconds)
    spent = [cpu_seconds(child.pid) - b for child, b in zip(children, before, strict=True)]
    sent = {stamp: at for stamp, at in raw.at.items() if stamp > first}
    last = max(sent) - 100_000_000
    sent = {stamp: at for stamp, at in sent.items() if stamp < last}
    time.sleep(1.0)
    arrived = {stamp: done.at[stamp] for stamp in sent if stamp in done.at}
    stop(children, spinner)
    whole = [(at - stamp) * 1e-6 for stamp, at in arrived.items()]
    names = ('compensation', 'filter', 'driver')
    return {
        'sent': len(sent),
        'lost': len(sent) - len(arrived),
        **percentiles([(at - sent[stamp]) * 1e-6 for stamp, at in arrived.items()]),
        'from_stamp_p50_ms': percentiles(whole)['p50_ms'],
        'from_stamp_p99_ms': percentiles(whole)['p99_ms'],
        **{f'cpu_{n}': round(s / seconds, 3) for n, s in zip(names, spent, strict=True)},
    }


class Arrivals:
    """Stamp → time of receipt [ns] of an Imu topic."""

    def __init__(self, node: Node, topic: str) -> None:
        self.at: dict[int, int] = {}
        node.create_subscription(Imu, topic, self._note, QOS)

    def _note(self, message: Imu) -> None:
        self.at[stamp_of(message)] = time.time_ns()


def percentiles(milliseconds: list[float]) -> dict[str, float]:
    p50, p99 = np.percentile(milliseconds or [np.nan], [50, 99])
    return {'p50_ms': round(float(p50), 2), 'p99_ms': round(float(p99), 2)}


def start(
    package: str, name: str, parameters: list[str], remaps: list[str] | None = None
) -> subprocess.Popen[bytes]:
    executable = Path(get_package_prefix(package)) / 'lib' / package / name
    arguments = [word for value in parameters for word in ('-p', value)]
    arguments += [word for value in remaps or [] for word in ('-r', value)]
    return subprocess.Popen([str(executable), '--ros-args', *arguments])


def stop(children: list[subprocess.Popen[bytes]], spinner: threading.Thread) -> None:
    for child in children:
        child.terminate()
    for child in children:
        child.wait()
    rclpy.try_shutdown()
    spinner.join(timeout=5.0)


def main() -> int:
    kind, seconds, *rest = sys.argv[1:]
    if kind == 'chain':
        result = chain(float(seconds), rest[0])
    else:
        result = one_node(float(seconds), float(rest[0]))
    print(json.dumps(result))
    return 0


if __name__ == '__main__':
    sys.exit(main())
