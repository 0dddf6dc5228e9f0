# SPDX-License-Identifier: Apache-2.0
"""chamber_profile_node: runs a profile on a chamber. Only `start` makes anything move."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.run_node import Interrupts, run_node
from rclpy.lifecycle import TransitionCallbackReturn
from std_msgs.msg import String
from std_srvs.srv import Trigger

from chamber_profile.periodic_thread import RunThread
from chamber_profile.run.chamber_link import ClockError
from chamber_profile.run.config import ChamberConfig, open_run
from chamber_profile.run.messages import (
    PHASE_TOPIC,
    RUN_TOPIC,
    chamber_messages,
    latched_texts,
    outputs,
    run_status,
    what_to_expect,
)
from chamber_profile.run.monitors import Witnesses
from chamber_profile.run.sequencer import COMMANDS


def spin_until_over(node: CommandedNode, look: Callable[[], None], interrupts: Interrupts) -> int:
    """Run the node until its run ends or it is interrupted; return the process's exit code."""
    obeyed = 0
    while True:
        look()
        if node.exit_code is not None:
            return int(node.exit_code)
        if obeyed and not node.in_charge:
            return 1
        if interrupts.count == obeyed:
            continue
        first, obeyed = obeyed == 0, interrupts.count  # copies of the first may be late
        if not node.in_charge:
            return 0
        if not first:
            node.get_logger().error('second interrupt: stand-by at once')
            node.stop_at_once()
            return 1
        node.get_logger().warning(
            'interrupted: to the safe temperature, then stop; interrupt again to stop at once'
        )
        node.order('abort')


class CommandedNode(ConfiguredNode):
    """Owns a run and the thread that advances it; `setup` of a subclass opens the run."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.run: Any = None
        self.exit_code: int | None = None
        """What the process shall exit with; None: it goes on."""
        self._thread: RunThread | None = None

    def advance(self) -> None:
        """One step of the run."""
        raise NotImplementedError

    def take_orders(self) -> None:
        """Open the services."""
        for name in COMMANDS:
            service = self.create_service(Trigger, f'~/{name}', self._answering(name))
            self._entities.append(partial(self.destroy_service, service))

    @property
    def in_charge(self) -> bool:
        """Whether a run is under way and the chamber depends on this process."""
        return self.run is not None and self.run.conductor.sequencer.in_charge

    def order(self, name: str) -> str:
        """Give an order (one of COMMANDS); return why it is refused, or ''."""
        refusal: str = self.run.conductor.sequencer.command(name)
        return refusal

    def activated(self) -> None:
        """Begin to watch the chamber."""
        if self._capture is None:
            self._thread = RunThread(self.advance, self.run.period_s, self.fail)

    def deactivated(self) -> None:
        """Stop watching; the chamber was made safe before, or stands by."""
        if self._thread is not None:
            self._thread.stop()
            self._thread = None

    def on_deactivate(self, state: Any) -> Any:
        """Refuse while a run is under way: abort it first."""
        if self.in_charge:
            self.get_logger().error('a run is under way: call ~/abort first')
            return TransitionCallbackReturn.FAILURE
        return super().on_deactivate(state)

    def end(self) -> None:
        """Leave nothing running that depends on this process."""
        if self.in_charge:
            self.stop_at_once()
        self.deactivated()

    def stop_at_once(self) -> None:
        """Put the chamber on stand-by without a ramp, whatever else is going on."""
        self.deactivated()
        self.run.conductor.stop_at_once()

    def fail(self) -> None:
        """Stop at once, for a reason nobody has thought of."""
        self.exit_code = 1
        self.run.conductor.stop_at_once()

    def _answering(self, name: str) -> Any:
        def answer(_: Any, response: Any) -> Any:
            refusal = self.order(name)
            response.success, response.message = not refusal, refusal or name
            return response

        return answer


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
