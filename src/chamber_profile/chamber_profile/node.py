# SPDX-License-Identifier: Apache-2.0
"""chamber_profile_node: runs a profile on a chamber. Only `start` makes anything move."""

from __future__ import annotations

from typing import Any

from imu_recording.run_node import run_node
from std_msgs.msg import String

from chamber_profile.chamber_link import ClockError
from chamber_profile.commanded_node import CommandedNode
from chamber_profile.interruptible_node import spin_until_over
from chamber_profile.node_config import ChamberConfig, open_run
from chamber_profile.run_messages import (
    PHASE_TOPIC,
    RUN_TOPIC,
    chamber_messages,
    latched_texts,
    outputs,
    run_status,
    what_to_expect,
)
from chamber_profile.witnesses import Witnesses


class ChamberProfileNode(CommandedNode):
    """Runs a thermal profile on a chamber and publishes chamber/…; only `start` moves anything.

    Orders are services: ~/start ~/pause ~/resume ~/abort ~/confirm. Ctrl-C takes the chamber to
    a safe temperature first; a second one stops it at once.
    """

    config_class = ChamberConfig

    def __init__(self, **options: Any) -> None:
        super().__init__('chamber_profile', **options)
        self.moment: Any = None
        self._complaint = ''

    def setup(self, config: ChamberConfig) -> None:
        """Open the run: nothing is connected yet, nothing moves."""
        simulated_time = self._now is not None or self.get_parameter('use_sim_time').value
        self.witnesses = Witnesses(config, self.now)
        self.run = open_run(config, self.now, self.witnesses.look, simulated_time=simulated_time)
        self.run.conductor.report = self.get_logger().info
        topics = outputs(temperatures=config.publish_temperature)
        self._outputs = {topic: self.output(kind, topic) for topic, kind in topics.items()}
        self._said: dict[str, str] = {}
        self._latched = {t: self.output(String, t, latched=True) for t in (RUN_TOPIC, PHASE_TOPIC)}
        for kind, topic, callback in self.witnesses.inputs():
            self.input(kind, topic, callback)
        self.take_orders()
        self._entities.append(self.run.conductor.close)

    def activated(self) -> None:
        """Begin to watch the chamber; `start:=true` also begins the run."""
        self.witnesses.excuse_imu()
        self.say()
        if self.config.start:
            self.order('start')
        elif self._capture is None:
            self.get_logger().info(what_to_expect(self.run, self.get_fully_qualified_name()))
        super().activated()

    def order(self, name: str) -> str:
        """Give an order; whoever confirms may have unplugged the IMU."""
        if name == 'confirm':
            self.witnesses.excuse_imu()
        return super().order(name)

    def advance(self) -> None:
        """One step of the run: read, decide, order, publish."""
        try:
            self.moment = self.run.conductor.step()
        except ClockError as error:
            self.get_logger().error(str(error))
            self.exit_code = 2
            return
        if self.moment.complaint != self._complaint:
            self._complaint = self.moment.complaint
            if self._complaint:
                self.get_logger().warning(self._complaint)
        self.say()
        for topic, message in chamber_messages(self.moment) if self.moment.due else ():
            if topic in self._outputs:
                self._outputs[topic].publish(message)
        if self.exit_code is None:
            self.exit_code = self.run.exit_code(self.moment.progress)

    def say(self) -> None:
        """Publish what is new about run and phase."""
        for topic, text in latched_texts(self.run).items():
            if text != self._said.get(topic):
                self._said[topic] = text
                self._latched[topic].publish(String(data=text))

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """State of run, chamber and link."""
        return run_status(self.moment, self.run) if self.moment else (0, self.state, {})


def main() -> int:
    """Run until the run ends or the node is interrupted; return the process's exit code."""
    return run_node(ChamberProfileNode, spin=spin_until_over)
