# SPDX-License-Identifier: Apache-2.0
"""chamber_profile_node: runs a profile on a chamber. Only `start` makes anything move."""

from __future__ import annotations

from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from imu_recording.lifecycle_node import ConfiguredNode
from rclpy.lifecycle import TransitionCallbackReturn
from sensor_msgs.msg import Temperature
from std_msgs.msg import String
from std_srvs.srv import Trigger

from chamber_profile.chamber_link import ClockError
from chamber_profile.interruptible_node import spin_until_over
from chamber_profile.node_config import ChamberConfig, open_run
from chamber_profile.run_messages import OUTPUTS, chamber_messages, phase_text, run_status
from chamber_profile.run_thread import RunThread
from chamber_profile.sequencer import COMMANDS
from chamber_profile.witnesses import Witnesses


class ChamberProfileNode(ConfiguredNode):
    """Publishes chamber/…, takes orders as services; a thread of its own talks to the chamber."""

    config_class = ChamberConfig

    def __init__(self, **options: Any) -> None:
        super().__init__('chamber_profile', **options)
        self.run: Any = None
        self.moment: Any = None
        self.exit_code: int | None = None
        self._thread: RunThread | None = None

    def setup(self, config: ChamberConfig) -> None:
        """Open the run: nothing is connected yet, nothing moves."""
        simulated_time = self._now is not None or self.get_parameter('use_sim_time').value
        self.witnesses = Witnesses(config, self.now)
        self.run = open_run(config, self.now, self.witnesses.look, simulated_time=simulated_time)
        self.run.conductor.report = self.get_logger().info
        self._phase = ''
        self._outputs = {
            topic: self.output(kind, topic)
            for topic, kind in OUTPUTS.items()
            if config.publish_temperature or 'temperature' not in topic
        }
        self._phase_output = self.output(String, 'chamber/phase', latched=True)
        for topic in config.imu_topics if config.require_imu else []:
            self.input(Temperature, topic, self.witnesses.on_imu)
        if not config.publish_temperature:
            self.input(Temperature, 'chamber/temperature', self.witnesses.on_air)
            self.input(Temperature, 'chamber/device_temperature', self.witnesses.on_device)
        self.input(DiagnosticArray, '/diagnostics', self.witnesses.on_diagnostics)
        for name in COMMANDS:
            service = self.create_service(Trigger, f'~/{name}', self._answering(name))
            self._entities.append(lambda service=service: self.destroy_service(service))
        self._entities.append(self.run.conductor.close)

    def activated(self) -> None:
        """Begin to watch the chamber; `start:=true` also begins the run."""
        self.witnesses.excuse_imu()
        if self.config.start:
            self.order('start')
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

    @property
    def in_charge(self) -> bool:
        """Whether a run is under way and the chamber depends on this process."""
        return self.run is not None and self.run.conductor.sequencer.in_charge

    def order(self, name: str) -> str:
        """Give an order (one of COMMANDS); return why it is refused, or ''."""
        if name == 'confirm':
            self.witnesses.excuse_imu()
        return self.run.conductor.sequencer.command(name)

    def stop_at_once(self) -> None:
        """Put the chamber on stand-by without a ramp, whatever else is going on."""
        self.deactivated()
        self.run.conductor.stop_at_once()

    def fail(self) -> None:
        """Stop at once, for a reason nobody has thought of."""
        self.exit_code = 1
        self.run.conductor.stop_at_once()

    def advance(self) -> None:
        """One step of the run: read, decide, order, publish."""
        try:
            self.moment = self.run.conductor.step()
        except ClockError as error:
            self.get_logger().error(str(error))
            self.exit_code = 2
            return
        for topic, message in chamber_messages(self.moment) if self.moment.due else ():
            if topic in self._outputs:
                self._outputs[topic].publish(message)
        phase = phase_text(self.moment)
        if phase and phase != self._phase:
            self._phase = phase
            self._phase_output.publish(String(data=phase))
        if self.exit_code is None:
            self.exit_code = self.run.exit_code(self.moment.progress)

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """State of run, chamber and link."""
        return run_status(self.moment, self.run) if self.moment else (0, self.state, {})

    def _answering(self, name: str) -> Any:
        def answer(_: Any, response: Any) -> Any:
            refusal = self.order(name)
            response.success, response.message = not refusal, refusal or name
            return response

        return answer


def main() -> int:
    """Run until the run ends or the node is interrupted; return the process's exit code."""
    return spin_until_over(ChamberProfileNode)
