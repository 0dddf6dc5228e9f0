# SPDX-License-Identifier: Apache-2.0
"""The smallest node: doubles what comes in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.messages import float_message
from imu_recording.ros.parameter import NodeConfig, parameter
from std_msgs.msg import Float64

STAMP = 1_700_000_000_500_000_000


@dataclass(frozen=True)
class DoublerConfig(NodeConfig):
    factor: float = parameter(2.0, 'Factor', bounds=(0.0, 10.0), dynamic=True)
    topic: str = parameter('out', 'Where to')
    weights: list[float] = parameter([1.0], 'Weights', bounds=(0.0, 2.0))  # noqa: RUF009


class Doubler(ConfiguredNode):
    config_class = DoublerConfig

    def setup(self, config: Any) -> None:
        if config.topic == 'taken':
            raise ValueError('topic taken: choose another')
        self.publisher = self.output(Float64, config.topic)
        self.input(Float64, 'in', self.on_number)

    def on_number(self, message: Any) -> None:
        self.publisher.publish(float_message(message.data * self.config.factor))

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        return 1, 'doubling', {'device': 'd', 'factor': self.config.factor}


def make(**parameters: Any) -> tuple[Doubler, list[tuple[str, Any]]]:
    sent: list[tuple[str, Any]] = []
    node = Doubler(
        'doubler',
        capture=lambda topic, message: sent.append((topic, message)),
        now=lambda: STAMP,
        parameters=parameters,
    )
    return node, sent
