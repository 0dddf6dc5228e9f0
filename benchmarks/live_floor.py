# SPDX-License-Identifier: Apache-2.0
"""The least that a node in Python costs which sends what the chain sends: peer of live_chain.py.

It reads the same line, counts the samples that arrive and publishes as many messages on the same
topics, serialised once and for all: nothing is decoded, stamped, compensated or estimated.

    python benchmarks/live_floor.py LINK RATE
"""

from __future__ import annotations

import gc
import os
import struct
import sys
import threading
import time

import rclpy
from imu_driver.board.session import DeviceSession, SessionConfig
from imu_driver.board.transport import SerialTransport
from imu_driver.wire.binary import DELIMITER
from imu_recording.ros import sample_bytes
from imu_recording.ros.messages import ImuSample, MagneticSample, TemperatureSample
from imu_recording.ros.run_node import MIDDLEWARE_PROFILES
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu, MagneticField, Temperature

SET_UP = 2.0
"""[s] of conversation with the board until it sends at the rate."""
SAMPLES_PER_FIELD, SAMPLES_PER_TEMPERATURE = 3, 4
"""As the board measures at 238 Hz."""


def set_up(line: SerialTransport, rate: float) -> None:
    """Let the board send at this rate [Hz]."""
    session = DeviceSession(SessionConfig(output_data_rate=rate))
    session.connected(time.time_ns())
    until = time.monotonic() + SET_UP
    while time.monotonic() < until:
        chunk, now = line.read(), time.time_ns()
        if chunk:
            session.feed(chunk, now)
        if command := session.outgoing(now):
            line.write(command)


def publish(line: SerialTransport, node: rclpy.node.Node) -> None:
    """Publish the chain's messages for every sample of the line."""
    qos = QoSProfile(depth=500)
    imu, field, temperature = (
        [node.create_publisher(kind, topic, qos).handle for topic in topics]
        for kind, topics in (
            (Imu, ('imu/data_raw', 'imu_compensated/data_raw', 'imu/data')),
            (MagneticField, ('imu/mag', 'imu_compensated/mag')),
            (Temperature, ('imu/temperature',)),
        )
    )
    imu_bytes = sample_bytes.imu_to_bytes(ImuSample(0, (0.0,) * 3, (0.0,) * 3))
    field_bytes = sample_bytes.field_to_bytes(MagneticSample(0, (0.0,) * 3))
    temperature_bytes = sample_bytes.temperature_to_bytes(TemperatureSample(0, 20.0))
    count = 0
    while rclpy.ok():
        chunk = line.read()
        for _ in range(chunk.count(DELIMITER)):
            count += 1
            stamp = struct.pack('<iI', *divmod(time.time_ns(), 10**9))
            for output in imu:
                output.publish_raw(imu_bytes[:4] + stamp + imu_bytes[12:])
            if count % SAMPLES_PER_FIELD == 0:
                for output in field:
                    output.publish_raw(field_bytes)
            if count % SAMPLES_PER_TEMPERATURE == 0:
                temperature[0].publish_raw(temperature_bytes)


def main() -> None:
    link, rate = sys.argv[1], float(sys.argv[2])
    os.environ.setdefault(*MIDDLEWARE_PROFILES)
    rclpy.init(args=[])
    node = rclpy.create_node('live_floor')
    line = SerialTransport(link, 921600)
    set_up(line, rate)
    gc.freeze()
    threading.Thread(target=publish, args=(line, node), daemon=True).start()
    executor = EventsExecutor()
    executor.add_node(node)
    while rclpy.ok():
        executor.spin_once(timeout_sec=0.2)


if __name__ == '__main__':
    main()
