# SPDX-License-Identifier: Apache-2.0
"""chamber_profile_node: runs a profile on a chamber. Only `start` makes anything move."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from imu_recording.logging_contract import PHASE_TOPIC
from imu_recording.recorder.run_announcement import RUN_TOPIC
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.run_node import Interrupts, run_node
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from std_msgs.msg import String
from std_srvs.srv import Trigger

from chamber_profile.periodic_thread import PeriodicThread
from chamber_profile.run.chamber_link import ClockError
from chamber_profile.run.conductor import RunSnapshot
from chamber_profile.run.config import ChamberConfig, Run, open_run
from chamber_profile.run.messages import (
    chamber_messages,
    latched_texts,
    output_types,
    ready_message,
    run_status,
)
from chamber_profile.run.monitors import RunMonitors
from chamber_profile.run.sequencer import COMMANDS


class ChamberProfileNode(ConfiguredNode):
    """Runs a thermal profile on a chamber and publishes chamber/…; only `start` moves anything.

    Commands are services: ~/start ~/pause ~/resume ~/abort ~/confirm. Ctrl-C takes the chamber to
    a safe temperature first; a second one stops it at once.
    """

    config_class = ChamberConfig
    task = 'run'
    hardware = 'chamber'
    config: ChamberConfig

    def __init__(self, **options: Any) -> None:
        super().__init__('chamber_profile', **options)
        self.exit_code: int | None = None
        """Exit code of the process; None: it goes on."""
        self._run: Run | None = None
        self._snapshot: RunSnapshot | None = None
        self._thread: PeriodicThread | None = None
        self._fault = ''

    @property
    def run(self) -> Run:
        """The run of the parameters; exists once the node is configured."""
        if self._run is None:
            raise RuntimeError('the node is not configured')
        return self._run

    @property
    def snapshot(self) -> RunSnapshot:
        """The run after its last step; exists once it has made one."""
        if self._snapshot is None:
            raise RuntimeError('the run has made no step')
        return self._snapshot

    @property
    def under_way(self) -> bool:
        """Whether a run is under way: the chamber depends on this process."""
        return self._run is not None and self._run.conductor.sequencer.under_way

    # Configuration ----------------------------------------------------------------------------

    def setup(self, config: ChamberConfig) -> None:
        """Open the run: nothing is connected yet, nothing moves."""
        simulated_time = bool(self._now or self.get_parameter('use_sim_time').value)
        self.monitors = RunMonitors(config, self.now)
        self._run = open_run(
            config, self.now, self.monitors.readings, simulated_time=simulated_time
        )
        self.run.conductor.report = self.get_logger().info
        types = output_types(temperatures=config.publish_temperature)
        self._outputs = {topic: self.output(kind, topic) for topic, kind in types.items()}
        self._latched_texts: dict[str, str] = {}
        self._latched = {t: self.output(String, t, latched=True) for t in (RUN_TOPIC, PHASE_TOPIC)}
        for kind, topic, callback in self.monitors.inputs():
            self.input(kind, topic, callback)
        for name in COMMANDS:
            service = self.create_service(Trigger, f'~/{name}', partial(self.on_command, name))
            self._entities.append(partial(self.destroy_service, service))
        self._entities.append(self.run.conductor.close)

    def activated(self) -> None:
        """Begin to read the chamber; `start:=true` also begins the run."""
        self.monitors.restart_imu_timeout()
        self.publish_latched()
        if self.config.start:
            self.command('start')
        elif self._capture is None:
            self.get_logger().info(ready_message(self.run, self.get_fully_qualified_name()))
        if self._capture is None:
            self._thread = PeriodicThread(self.advance, self.run.period_s, self.fail)

    def deactivated(self) -> None:
        """Stop reading; the chamber is on stand-by, or was never started."""
        if self._thread is not None:
            self._thread.stop()
            self._thread = None

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Refuse while a run is under way: abort it first."""
        if self.under_way:
            self.get_logger().error('a run is under way: call ~/abort first')
            return TransitionCallbackReturn.FAILURE
        return super().on_deactivate(state)

    # The run ----------------------------------------------------------------------------------

    def on_command(
        self, name: str, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Answer a service: whether the command is accepted, or why not."""
        refusal = self.command(name)
        response.success, response.message = not refusal, refusal or name
        return response

    def command(self, name: str) -> str:
        """Give a command (one of COMMANDS); return why it is refused, '' where it is not."""
        if name == 'confirm':  # the IMU may have been unplugged while the devices were turned
            self.monitors.restart_imu_timeout()
        return self.run.conductor.sequencer.command(name)

    def advance(self) -> None:
        """One step of the run: read, decide, order, publish."""
        try:
            snapshot = self._snapshot = self.run.conductor.step()
        except ClockError as error:
            self.get_logger().error(str(error))
            self.exit_code = 2
            return
        if snapshot.fault != self._fault:
            self._fault = snapshot.fault
            if self._fault:
                self.get_logger().warning(self._fault)
        self.publish_latched()
        for topic, message in chamber_messages(snapshot):
            if topic in self._outputs:
                self._outputs[topic].publish(message)
        if self.exit_code is None:
            self.exit_code = self.run.exit_code(snapshot.progress)

    def publish_latched(self) -> None:
        """Publish chamber/run and chamber/phase where they have changed."""
        for topic, text in latched_texts(self.run).items():
            if text != self._latched_texts.get(topic):
                self._latched_texts[topic] = text
                self._latched[topic].publish(String(data=text))

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """State of run, chamber and link."""
        return run_status(self._snapshot, self.run) if self._snapshot else (0, self.state, {})

    # The end ----------------------------------------------------------------------------------

    def end(self) -> None:
        """Stop the chamber where a run is under way: it depends on this process."""
        if self.under_way:
            self.stop_at_once()
        self.deactivated()

    def stop_at_once(self) -> None:
        """Put the chamber on stand-by now, without a ramp."""
        self.deactivated()
        self.run.conductor.stop_at_once()

    def fail(self) -> None:
        """Put the chamber on stand-by after an unexpected error of the run's thread."""
        self.exit_code = 1
        self.run.conductor.stop_at_once()


def spin_until_over(
    node: ChamberProfileNode, spin_once: Callable[[], None], interrupts: Interrupts
) -> int:
    """Spin until the run ends or is interrupted; return the process's exit code.

    The first interrupt takes the chamber to the safe state, the second stops it at once.
    """
    handled = 0
    while True:
        spin_once()
        if node.exit_code is not None:
            return node.exit_code
        if handled and not node.under_way:
            return 1
        if interrupts.count == handled:
            continue
        first, handled = handled == 0, interrupts.count  # copies of the first may be late
        if not node.under_way:
            return 0
        if not first:
            node.get_logger().error('second interrupt: stand-by at once')
            node.stop_at_once()
            return 1
        node.get_logger().warning(
            'interrupted: to the safe temperature, then stop; interrupt again to stop at once'
        )
        node.command('abort')


def main() -> int:
    """Run until the run ends or the node is interrupted; return the process's exit code."""
    return run_node(ChamberProfileNode, spin=spin_until_over)
