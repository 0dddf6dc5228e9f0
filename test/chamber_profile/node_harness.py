# SPDX-License-Identifier: Apache-2.0
"""A chamber node without a process: what it published, and its clock."""

from pathlib import Path

from chamber_profile.node import ChamberProfileNode
from sensor_msgs.msg import Temperature
from std_srvs.srv import Trigger

SECOND = 1_000_000_000


class NodeHarness:
    """A node, what it published, and its clock."""

    def __init__(self, directory: Path, **parameters) -> None:
        self.stamp = 1_000 * SECOND
        self.sent: list[tuple[str, object]] = []
        self.imu = True
        values = {
            'profile': 'short_20min',
            'run_directory': str(directory),
            'chamber': 'simulated?seed=2',
            **parameters,
        }
        self.node = ChamberProfileNode(
            capture=lambda topic, message: self.sent.append((topic, message)),
            now=lambda: self.stamp,
            parameters=values,
        )
        self.started = self.node.autostart()

    @property
    def mode(self) -> str:
        return self.node.snapshot.progress.mode

    def step(self, seconds: float = 1.0) -> None:
        self.stamp += int(seconds * SECOND)
        if self.imu and 'imu/temperature' in self.node.inputs:
            self.node.inputs['imu/temperature'](Temperature())
        self.node.advance()

    def until(self, condition, longest: int = 5000) -> None:
        for _ in range(longest):
            self.step()
            if condition():
                return
        raise AssertionError(self.node.snapshot)

    def call(self, service: str) -> Trigger.Response:
        return self.node.on_command(service, Trigger.Request(), Trigger.Response())

    def topics(self) -> set[str]:
        return {topic for topic, _ in self.sent}
