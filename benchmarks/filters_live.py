# SPDX-License-Identifier: Apache-2.0
"""Feeds an ahrs_filter process over DDS and counts what comes back; run by filters.py.

python benchmarks/filters_live.py SECONDS RATE_HZ RAW(0|1) prints one JSON line.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import rclpy
from imu_recording.messages import (
    ImuSample,
    MagneticSample,
    imu_from_sample,
    magnetic_field_from_sample,
    stamp_of,
)
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, MagneticField

BATCH_S = 0.005
"""Messages are due on their own clock and sent in bursts of this length."""
TICKS = os.sysconf('SC_CLK_TCK')


def cpu_seconds(process: int) -> float:
    fields = Path(f'/proc/{process}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


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


def main() -> int:
    seconds, rate_hz, raw = float(sys.argv[1]), float(sys.argv[2]), sys.argv[3] == '1'
    executable = shutil.which('ahrs_filter_node') or _installed('ahrs_filter_node')
    command = [executable, '--ros-args', '-p', f'raw_subscription:={str(raw).lower()}']
    child = subprocess.Popen([*command, '-p', 'publish_euler:=false'])
    rclpy.init()
    node = rclpy.create_node('filters_live')
    qos = QoSProfile(depth=500, reliability=ReliabilityPolicy.RELIABLE)
    out = node.create_publisher(Imu, 'imu/data_raw', qos)
    out_field = node.create_publisher(MagneticField, 'imu/mag', qos)
    latency: list[float] = []
    seen: set[int] = set()

    def on_data(message: Imu) -> None:
        stamp = stamp_of(message)
        seen.add(stamp)
        latency.append(time.time_ns() - stamp)

    node.create_subscription(Imu, 'imu/data', on_data, qos)
    spinner = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
    spinner.start()
    while not (node.count_subscribers('imu/data_raw') and node.count_publishers('imu/data')):
        time.sleep(0.1)
    time.sleep(1.0)
    count = round(seconds * rate_hz)
    before = cpu_seconds(child.pid)
    feed(out, out_field, count, rate_hz)
    deadline = time.monotonic() + 5.0
    while len(seen) < count and time.monotonic() < deadline:
        time.sleep(0.05)
    spent = cpu_seconds(child.pid) - before
    milliseconds = np.array(latency) * 1e-6
    result = {
        'sent': count,
        'lost': count - len(seen),
        'cpu_us_per_message': round(spent / count * 1e6, 1),
        'p50_ms': round(float(np.percentile(milliseconds, 50)), 2),
        'p99_ms': round(float(np.percentile(milliseconds, 99)), 2),
    }
    child.terminate()
    child.wait()
    rclpy.try_shutdown()
    spinner.join(timeout=5.0)
    print(json.dumps(result))
    return 0


def _installed(name: str) -> str:
    from ament_index_python.packages import get_package_prefix

    prefix = Path(get_package_prefix('orientation_filters'))
    return str(prefix / 'lib' / 'orientation_filters' / name)


if __name__ == '__main__':
    sys.exit(main())
