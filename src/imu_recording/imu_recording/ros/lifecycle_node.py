# SPDX-License-Identifier: Apache-2.0
"""What all nodes of this workspace share: parameters, lifecycle, diagnostics, shutdown.

A node subclasses `ConfiguredNode`, names its frozen config dataclass and writes `setup`; it then
configures and activates itself under plain `ros2 run` (parameter `autostart`). Replay and tests
construct the same class with `capture` and `now` and call its callbacks directly.
"""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import Field, fields, replace
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from imu_recording.ros.diagnostics import (
    NO_HARDWARE,
    InputTimeout,
    Status,
    StatusLog,
    diagnostic_array,
)
from imu_recording.ros.exchange import CapturedOutput, Exchange, SampleOutput
from imu_recording.ros.losses import Losses, nothing_heard
from imu_recording.ros.parameter import (
    NodeConfig,
    ParameterError,
    checked,
    config_from_values,
    converted,
    default_of,
    listed,
    unknown_parameters,
)
from imu_recording.ros.sample_bytes import form_of

ACTIVE = 'active'
INACTIVE = 'inactive'
UNCONFIGURED = 'unconfigured'
DIAGNOSTICS = '/diagnostics'


def latched_qos() -> QoSProfile:
    """Return the profile under which who subscribes later still gets the newest message."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def overridable() -> QoSOverridingOptions:
    """Return that parameters `qos_overrides.<topic>.…` may change a profile."""
    return QoSOverridingOptions(
        (
            QoSPolicyKind.HISTORY,
            QoSPolicyKind.DEPTH,
            QoSPolicyKind.RELIABILITY,
            QoSPolicyKind.DURABILITY,
        )
    )


class ConfiguredNode(LifecycleNode):  # type: ignore[misc]
    """A lifecycle node whose parameters are the fields of a frozen dataclass.

    Subclasses set `config_class` and implement `setup(config)`, which creates inputs and outputs,
    and `diagnostics()`. With `capture`, outputs call `capture(topic, message)`, nothing is sent;
    `inputs` maps topic to callback for those who feed messages by hand. `now` replaces the
    clock. Nodes of one process that share an `exchange` pass samples to each other as values,
    in the sender's thread; `lock` keeps what samples, timers and parameters do apart.
    `known_elsewhere` names parameters that other nodes of the process have.
    """

    config_class: ClassVar[type[NodeConfig]] = NodeConfig
    event_driven: ClassVar[bool] = False
    """Whether `run_node` uses the events executor: half the cost per message at high rates."""
    task: ClassVar[str] = 'node'
    """What `diagnostics` is about: the second half of its name on /diagnostics."""
    hardware: ClassVar[str] = NO_HARDWARE
    """hardware_id where no task's values have a `device`."""
    logs_status: ClassVar[bool] = False
    """Whether what `diagnostics` says is logged too where it changes."""
    captures_bytes: ClassVar[bool] = False
    """Whether `capture` gets samples serialised, for the sake of simulated campaigns."""
    expects: ClassVar[str] = ''
    """Input that must not stop: a warning when it does; where there is one, status is logged."""

    def __init__(
        self,
        name: str,
        *,
        capture: Callable[[str, Any], None] | None = None,
        now: Callable[[], int] | None = None,
        parameters: Mapping[str, Any] | None = None,
        exchange: Exchange | None = None,
        known_elsewhere: Collection[str] = (),
        **node_options: Any,
    ) -> None:
        self.lock = threading.RLock()
        self._active = False
        overrides = [Parameter(key, value=value) for key, value in (parameters or {}).items()]
        super().__init__(name, parameter_overrides=overrides, **node_options)
        self._capture = capture
        self._now = now
        self._exchange = exchange or Exchange()
        self._entities: list[Callable[[], None]] = []
        self.inputs: dict[str, Callable[[Any], None]] = {}
        self.outputs: list[str] = []
        self.hosted: list[ConfiguredNode] = []
        """Nodes that `run_node` runs beside this one, in the same executor."""
        self.refused = ''
        self._status_logs: dict[str, StatusLog] = {}
        """Of the first task, and of each that ever was not in order."""
        self._input_timeout = InputTimeout()
        self.losses = Losses()
        self._fields = {item.name: item for item in fields(self.config_class)}
        for item in self._fields.values():
            given = self._parameter_overrides.get(item.name)
            if given is not None:
                if item.metadata['bounds']:  # told here, as rcl's words are hard to read
                    checked(item, given.value)
                self._parameter_overrides[item.name] = self._typed(given)
            descriptor = parameter_descriptor(item)
            self.declare_parameter(item.name, ros_value(default_of(item)), descriptor)
        self.add_pre_set_parameters_callback(self._all_typed)
        self.add_on_set_parameters_callback(self._on_set_parameters)
        known = {*self._fields, *known_elsewhere}
        for note in unknown_parameters(self._parameter_overrides, known):
            self.get_logger().warning(note)
        self._diagnostics_publisher = self._publisher(
            DiagnosticArray, DIAGNOSTICS, QoSProfile(depth=10), managed=False
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

    def reconfigured(self, config: Any) -> None:
        """Take over dynamic parameters that changed while configured."""

    def diagnostics(self) -> Status:
        """Return level (0 ok, 1 warn, 2 error), one line, and values for /diagnostics."""
        return 0, self.state, {}

    def tasks(self) -> dict[str, Status]:
        """Return the status of each task; the first says most of the node."""
        return {self.task: self.diagnostics()}

    # What a subclass uses ---------------------------------------------------------------------

    @property
    def state(self) -> str:
        """Lifecycle state: 'unconfigured', 'inactive', 'active' …"""
        return str(self._state_machine.current_state[1])

    def now(self) -> int:
        """Return ROS time [ns]."""
        if self._now:
            return self._now()
        with (clock := self.get_clock().handle):  # `Clock.now` makes an object of it besides
            return int(clock.get_now().nanoseconds)

    def output(self, message_type: type, topic: str, *, latched: bool = False) -> Any:
        """Create a reliable publisher that sends while the node is active."""
        qos = QoSProfile(depth=self.config.qos_depth, reliability=ReliabilityPolicy.RELIABLE)
        qos = latched_qos() if latched else qos
        publisher = self._publisher(message_type, topic, qos, managed=True)
        self.outputs.append(topic)
        if not self._capture:
            self._entities.append(lambda: self.destroy_lifecycle_publisher(publisher))
        return publisher

    def sample_output(self, message_type: type, topic: str) -> Any:
        """Create an output whose `send` takes samples of a message type that `form_of` knows."""
        publisher, form = self.output(message_type, topic), form_of(message_type)
        if self._capture:
            return CapturedOutput(
                publisher, form.to_bytes if self.captures_bytes else form.to_message
            )
        local = self._exchange.topic(self.resolve_topic_name(topic))
        local.offered += 1

        def withdraw() -> None:
            local.offered -= 1

        self._entities.append(withdraw)
        return SampleOutput(publisher, form, local, self._exchange.outbox)

    def sample_input(
        self, message_type: type, topic: str, callback: Callable[[Any], None]
    ) -> None:
        """Call back with samples while the node is active: of this process, else of messages."""
        form = form_of(message_type)
        name = self.resolve_topic_name(topic)
        if not self._capture and self._exchange.offers(name):  # where nothing gets lost
            take = self._when_active(topic, callback)
            self._entities.append(self._exchange.topic(name).listen(take, serialised=False))
        else:
            if topic == self.expects:
                callback = self._gaps_counted(name, callback)
            self.input(message_type, topic, lambda data: callback(form.from_bytes(data)), raw=True)
        self.inputs[topic] = lambda message: callback(form.from_message(message))

    def _gaps_counted(self, name: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        count = self.losses.gaps_of(name).add

        def counted(sample: Any) -> None:
            count(sample.stamp)
            callback(sample)

        return counted

    def serialised_input(self, topic: str, callback: Callable[[bytes], None]) -> bool:
        """Call back with the messages of a topic of this process; False where it has none."""
        if not self._exchange.offers(topic):
            return False
        self.inputs[topic] = callback
        take = self._when_active(topic, callback)
        self._entities.append(self._exchange.topic(topic).listen(take, serialised=True))
        return True

    def _when_active(self, topic: str, callback: Callable[[Any], None]) -> Callable[[Any], None]:
        timeout = self._input_timeout if topic == self.expects else None

        def when_active(received: Any) -> None:
            with self.lock:
                if self._active:
                    if timeout:
                        timeout.heard()
                    callback(received)

        return when_active

    def input(
        self, message_type: type, topic: str, callback: Callable[[Any], None], **options: Any
    ) -> None:
        """Subscribe best effort; the callback runs while the node is active."""
        self.inputs[topic] = callback
        if self._capture:
            return
        qos = QoSProfile(depth=self.config.qos_depth, reliability=ReliabilityPolicy.BEST_EFFORT)

        subscription = self.create_subscription(
            message_type,
            topic,
            self._when_active(topic, callback),
            options.pop('qos', qos),
            event_callbacks=self._loss_events(topic),
            qos_overriding_options=overridable(),
            **options,
        )
        self._entities.append(lambda: self.destroy_subscription(subscription))

    def diagnostics_input(self, sent: str, callback: Callable[[DiagnosticArray], None]) -> None:
        """Call back with the diagnostics of the process if it sends the topic `sent`, else of all.

        Those of the process come before what is sent afterwards.
        """
        if self._capture or not self._exchange.offers(self.resolve_topic_name(sent)):
            self.input(DiagnosticArray, DIAGNOSTICS, callback)
            return
        self.inputs[DIAGNOSTICS] = callback
        take = self._when_active(DIAGNOSTICS, callback)
        topic = self._exchange.topic(self.resolve_topic_name(DIAGNOSTICS))
        self._entities.append(topic.listen(take, serialised=False))

    def _loss_events(self, topic: str) -> SubscriptionEventCallbacks:
        name = self.resolve_topic_name(topic)

        def lost(event: Any) -> None:
            self.losses.dropped[name] += event.total_count_change

        return SubscriptionEventCallbacks(message_lost=lost)

    def _never_heard(self) -> str:
        """Return why the input that must come has brought nothing yet; '' where it has."""
        if self._capture or not self.expects or not self._input_timeout.is_overdue:
            return ''
        topic = self.resolve_topic_name(self.expects)
        if self._exchange.offers(topic):
            return f'{topic}: no sample yet'
        topics = dict(self.get_topic_names_and_types())
        kinds = topics.get(topic, [])
        own = {topic, *map(self.resolve_topic_name, self.outputs)}
        others = [
            name
            for name, types in sorted(topics.items())
            if name not in own and types == kinds and self.count_publishers(name)
        ]
        return nothing_heard(topic, self.count_publishers(topic), others)

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
        for take in self._exchange.topic(self.resolve_topic_name(DIAGNOSTICS)).samples:
            take(message)

    def _statuses(self) -> dict[str, Status]:
        if self.refused and self.state == UNCONFIGURED:
            return {self.task: (2, self.refused, {})}
        with self.lock:
            statuses = self.tasks()
        if self.inputs and self.state == ACTIVE:
            statuses['input'] = self._input_status()
        return statuses

    def _input_status(self) -> Status:
        """Return whether what this node listens to comes, and all of it."""
        status: Status = 0, 'receiving', {'topics': len(self.inputs)}
        if self.expects:
            status = self._input_timeout.applied(self.resolve_topic_name(self.expects), status)
        if reason := self._never_heard():
            status = 1, reason, status[2]
        return self.losses.applied(status)

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

    def _release(self) -> None:
        for release in self._entities:
            release()
        self._entities.clear()
        self.inputs.clear()
        self.outputs.clear()

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

    def _in_and_out(self) -> str:
        """Return the topics of this node under their full names."""
        parts = [
            f'{word} {", ".join(map(self.resolve_topic_name, topics))}'
            for word, topics in (('listens to', self.inputs), ('publishes', self.outputs))
            if topics
        ]
        return f'active: {"; ".join(parts)}' if parts else 'active'

    def _publisher(self, message_type: type, topic: str, qos: QoSProfile, *, managed: bool) -> Any:
        if self._capture:
            return CapturedPublisher(topic, self._capture)
        create = self.create_lifecycle_publisher if managed else self.create_publisher
        return create(message_type, topic, qos, qos_overriding_options=overridable())

    # Parameters -------------------------------------------------------------------------------

    def _values(self) -> dict[str, Any]:
        values = {name: self.get_parameter(name).value for name in self._fields}
        return {
            name: [] if isinstance(value, list) and value == [''] else value
            for name, value in values.items()
        }

    def _typed(self, given: Parameter) -> Parameter:
        """Return a parameter of the type it is declared with, or raise ParameterError."""
        value = ros_value(converted(self._fields[given.name], given.value))
        return Parameter(given.name, value=value)

    def _all_typed(self, changes: list[Parameter]) -> list[Parameter]:
        """Return the parameters, whole numbers as doubles where those are declared."""
        typed = []
        for change in changes:
            if change.name not in self._fields:
                typed.append(change)
                continue
            try:
                typed.append(self._typed(change))
            except ParameterError:  # the declared type refuses it
                typed.append(change)
        return typed

    def _new(self, change: Parameter) -> bool:
        now = self.get_parameter(change.name)
        return bool(change.get_parameter_value() != now.get_parameter_value())

    def _on_set_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        own = [change for change in changes if change.name in self._fields and self._new(change)]
        running = self.state in (INACTIVE, ACTIVE)  # while configuring, presets may be filled in
        try:
            values = {c.name: checked(self._fields[c.name], c.value) for c in own}
            fixed = [name for name in values if not self._fields[name].metadata['dynamic']]
            if running and fixed:
                raise ParameterError(
                    f'{fixed[0]} takes effect at configuration: deactivate and clean up first'
                )
            if running and values:
                config = replace(self.config, **values)
                with self.lock:
                    self.reconfigured(config)
                    self.config = config
        except (ValueError, OSError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


class CapturedPublisher:
    """Stands in for a publisher: hands every message to a function instead of DDS."""

    def __init__(self, topic: str, capture: Callable[[str, Any], None]) -> None:
        self.topic_name = topic
        self._capture = capture

    def publish(self, message: Any) -> None:
        """Hand the message over."""
        self._capture(self.topic_name, message)


def ros_value(value: Any) -> Any:
    """Return a value that has a type in rclpy: an empty list has none, `_values` turns it back."""
    return [''] if value == [] else value


def parameter_descriptor(item: Field[Any]) -> ParameterDescriptor:
    """Return the descriptor of a field declared by `parameter`."""
    metadata = item.metadata
    unit = f' [{metadata["unit"]}]' if metadata['unit'] else ''
    choices = f'; one of {listed(metadata["choices"])}' if metadata['choices'] else ''
    descriptor = ParameterDescriptor(description=f'{metadata["description"]}{unit}{choices}')
    if metadata['bounds']:
        low, high = metadata['bounds']
        descriptor.additional_constraints = f'{low:g} … {high:g}'
        if isinstance(default_of(item), int):
            bounds = IntegerRange(from_value=int(low), to_value=int(high))
            descriptor.integer_range = [bounds]
        else:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
    return descriptor
