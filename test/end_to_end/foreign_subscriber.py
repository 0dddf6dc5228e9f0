# SPDX-License-Identifier: Apache-2.0
"""A subscriber from another robot stack: knows sensor_msgs and topics, nothing of this project.

Usage: foreign_subscriber.py COUNT SECONDS TOPIC=TYPE … [node:NAME …]
Receives COUNT messages of every topic, once with the default and once with the sensor-data quality
of service, and one status of every node named on /diagnostics; prints the last message of each as
JSON. Exit code 1 when SECONDS passed before.
"""

import json
import sys
import time

import diagnostic_msgs.msg
import rclpy
import sensor_msgs.msg
from rclpy.qos import QoSProfile, qos_profile_sensor_data

TYPES = {
    'Imu': sensor_msgs.msg.Imu,
    'MagneticField': sensor_msgs.msg.MagneticField,
    'Temperature': sensor_msgs.msg.Temperature,
    'DiagnosticArray': diagnostic_msgs.msg.DiagnosticArray,
}
QUALITIES = {'default': QoSProfile(depth=10), 'sensor_data': qos_profile_sensor_data}


def plain(message: object) -> object:
    """Return a message as JSON values."""
    if hasattr(message, 'get_fields_and_field_types'):
        names = message.get_fields_and_field_types()
        return {name: plain(getattr(message, name)) for name in names}
    if isinstance(message, bytes):
        return list(message)
    if hasattr(message, 'tolist'):
        return message.tolist()
    if isinstance(message, list | tuple):
        return [plain(item) for item in message]
    return message


def main() -> int:
    count, seconds, *wanted = sys.argv[1:]
    rclpy.init()
    node = rclpy.create_node('foreign_subscriber')
    received: dict[str, int] = {}
    last: dict[str, object] = {}

    def subscribe(topic: str, kind: str, quality: str) -> None:
        key = f'{topic} {quality}'
        received[key] = 0

        def on_message(message: object) -> None:
            received[key] += 1
            last[key] = message

        node.create_subscription(TYPES[kind], topic, on_message, QUALITIES[quality])

    awaited = {item.removeprefix('node:') for item in wanted if item.startswith('node:')}

    def on_diagnostics(message: diagnostic_msgs.msg.DiagnosticArray) -> None:
        awaited.difference_update(status.name.partition(':')[0] for status in message.status)

    node.create_subscription(TYPES['DiagnosticArray'], '/diagnostics', on_diagnostics, 10)
    for item in wanted:
        for quality in () if item.startswith('node:') else QUALITIES:
            subscribe(*item.split('='), quality)

    def missing() -> bool:
        return bool(awaited) or min(received.values()) < int(count)

    deadline = time.monotonic() + float(seconds)
    while missing() and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.1)
    print(json.dumps({'received': received, 'last': {k: plain(m) for k, m in last.items()}}))
    node.destroy_node()
    rclpy.try_shutdown()
    return int(missing())


if __name__ == '__main__':
    sys.exit(main())
