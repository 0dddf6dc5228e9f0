# SPDX-License-Identifier: Apache-2.0
"""Base class of all nodes of this workspace: parameters, lifecycle, diagnostics, shutdown.

A node subclasses `ConfiguredNode`, names its frozen config dataclass and writes `setup`; it then
configures and activates itself under plain `ros2 run` (parameter `autostart`). Replay and tests
construct the same class with `capture` and `now` and call its callbacks directly.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from imu_recording.ros.diagnostics import NO_HARDWARE, Status, StatusLog, diagnostic_array
from imu_recording.ros.parameter import config_from_values
from imu_recording.ros.parameter_node import ACTIVE, UNCONFIGURED
from imu_recording.ros.topic_node import DIAGNOSTICS_TOPIC, TopicNode


class ConfiguredNode(TopicNode):
    """A lifecycle node with parameters (`ParameterNode`) and inputs and outputs (`TopicNode`).

    Subclasses set `config_class` and implement `setup(config)`, which creates inputs and outputs,
    and `diagnostics()`.
    """

    event_driven: ClassVar[bool] = False
    """Whether `run_node` uses the events executor: half the cost per message at high rates."""
    task: ClassVar[str] = 'node'
    """Task that `diagnostics` is about: the second half of its name on /diagnostics."""
    hardware: ClassVar[str] = NO_HARDWARE
    """hardware_id where no task's values have a `device`."""
    logs_status: ClassVar[bool] = False
    """Whether the status of `diagnostics` is logged, too, where it changes."""

    def __init__(self, name: str, **options: Any) -> None:
        self.hosted: list[ConfiguredNode] = []
        """Nodes that `run_node` runs beside this one, in the same executor."""
        self.refused = ''
        self._status_logs: dict[str, StatusLog] = {}
        """By task: the first one, and each that has had a warning or an error."""
        super().__init__(name, **options)
        self._diagnostics_publisher = self._publisher(
            DiagnosticArray, DIAGNOSTICS_TOPIC, QoSProfile(depth=10), managed=False
        )
        self._diagnostics_timer = self.create_timer(1.0, self.publish_diagnostics)

    # What a subclass writes -------------------------------------------------------------------

    def setup(self, config: Any) -> None:
        """Create inputs, outputs and state for `config`; raise ValueError or OSError to refuse."""
        raise NotImplementedError

    def activated(self) -> None:
        """Act on activation (start a thread, a stream …)."""

    def deactivated(self) -> None:
        """Undo `activated`."""

    def end(self) -> None:
        """Undo what is under way before the process ends."""
        if self.state == ACTIVE:
            self.deactivated()

    def diagnostics(self) -> Status:
        """Return level (0 ok, 1 warn, 2 error), one line, and values for /diagnostics."""
        return 0, self.state, {}

    def tasks(self) -> dict[str, Status]:
        """Return the status of each task: first that of `diagnostics`."""
        return {self.task: self.diagnostics()}

    # Diagnostics ------------------------------------------------------------------------------

    def publish_diagnostics(self) -> None:
        """Publish one DiagnosticArray with the status of each task of this node."""
        statuses = self._statuses()
        if (self.logs_status or self.expects) and self.state == ACTIVE and not self._capture:
            for task, (level, line, _) in statuses.items():
                if level or task == self.task or task in self._status_logs:
                    self._log_status(task, level, line)
        self.send_diagnostics(statuses)

    def send_diagnostics(self, statuses: Mapping[str, Status]) -> None:
        """Send the status of each of these tasks: on /diagnostics and to nodes of the process."""
        name = self.get_fully_qualified_name().lstrip('/')
        message = diagnostic_array(name, self.now(), statuses, self.hardware)
        self._diagnostics_publisher.publish(message)
        for take in self._exchange.topic(self.resolve_topic_name(DIAGNOSTICS_TOPIC)).samples:
            take(message)

    def _statuses(self) -> dict[str, Status]:
        if self.refused and self.state == UNCONFIGURED:
            return {self.task: (2, self.refused, {})}
        with self.lock:
            statuses = self.tasks()
        if self.inputs and self.state == ACTIVE:
            statuses['input'] = self._input_status()
        return statuses

    def _log_status(self, task: str, level: int, line: str) -> None:
        log = self._status_logs.setdefault(task, StatusLog())
        if not log.is_new(time.monotonic(), level, line):
            return
        if level == 0:  # rclpy wants a line of its own for each severity
            self.get_logger().info(line)
        elif level == 1:
            self.get_logger().warning(line)
        else:
            self.get_logger().error(line)

    def refuse(self, reason: str) -> None:
        """Note why this node does not work, once; log it where nobody captures the output."""
        if not self.refused and not self._capture:
            self.get_logger().error(reason)
        self.refused = reason

    @property
    def refuser(self) -> str:
        """Full name of the node whose parameters were refused: this one, or one it hosts."""
        refusing = [node for node in self.hosted if node.refused]
        return str((refusing or [self])[0].get_fully_qualified_name())

    # Lifecycle --------------------------------------------------------------------------------

    def autostart(self, configured: Callable[[], None] = lambda: None) -> bool:
        """Configure, call `configured`, activate; return False where either was refused."""
        done = self.trigger_configure() == TransitionCallbackReturn.SUCCESS
        configured()
        return bool(done and self.trigger_activate() == TransitionCallbackReturn.SUCCESS)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the parameters and set up."""
        self.refused = ''
        try:
            with self._errors_logged():
                self.config = config_from_values(self.config_class, self._values())
                self.setup(self.config)
        except (ValueError, OSError) as error:
            self.refuse(str(error))
            self._release()
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start."""
        result = super().on_activate(state)
        self._input_timeout.restart()
        if not self._capture:
            self.get_logger().info(self._in_and_out())
        with self._errors_logged():
            self.activated()
        self._active = True
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop."""
        self._active = False
        self.deactivated()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release what `setup` created."""
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop and release."""
        self._active = False
        if state.label == ACTIVE:
            self.deactivated()
        self._release()
        return super().on_shutdown(state)

    @contextmanager
    def _errors_logged(self) -> Iterator[None]:
        """Log an unexpected error: rclpy turns any error of a transition into a state."""
        try:
            yield
        except (ValueError, OSError):
            raise
        except Exception:
            self.get_logger().fatal(traceback.format_exc())
            raise
