# SPDX-License-Identifier: Apache-2.0
"""A whole campaign in one process: chamber, drivers and recorder nodes in lock-step on one clock.

Nothing is spun and nothing goes over DDS: the clock is a number, every node's own callbacks are
called in turn, and what they publish is handed to the recorder.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from chamber_profile.chambers.simulated import SimulatedChamber
from chamber_profile.node import ChamberProfileNode
from chamber_profile.profile.values import OPERATOR_PHASE
from chamber_profile.run.values import CONFIRM, DONE
from imu_driver.board.lsm9ds1 import DEFAULT_FULL_SCALE
from imu_driver.board.sample import SampleScale
from imu_driver.node import ImuDriverNode
from imu_driver.simulation.read_out import SIMULATOR
from imu_driver.simulation.stream import SimulatedDevice
from imu_driver.wire.frames import MAGNETOMETER_NEW, TEMPERATURE_NEW, DataFrame
from imu_recording.logging_contract import (
    IMU_TOPIC,
    MAGNETIC_TOPIC,
    STRING,
    TEMPERATURE_TOPIC,
    TRACK_OF_TOPIC,
)
from imu_recording.recorder.node import RecorderNode
from imu_recording.recorder.run_announcement import RUN_TOPIC
from imu_recording.recording import SECOND_NS
from imu_recording.ros.message_cdr import serialise, type_of
from imu_recording.user_error import UserError
from rclpy.context import Context
from rclpy.logging import LoggingSeverity

from imu_workbench.isolated_context import quiet_context

FIRST_START_NS = 1_767_225_600 * SECOND_NS
"""Start of the first run, 2026-01-01 00:00 UTC; each run has a day of its own [ns]."""
DAY_NS = 86_400 * SECOND_NS
DRIVER_MESSAGE_TYPES = {
    topic: TRACK_OF_TOPIC[topic].message_type
    for topic in (IMU_TOPIC, MAGNETIC_TOPIC, TEMPERATURE_TOPIC)
}
"""Types of the messages that the driver publishes serialised, by topic."""


class CampaignError(UserError):
    """A campaign that cannot be run; the message says why."""


@dataclass(frozen=True)
class RunPlan:
    """One run of a campaign."""

    profile: Path
    """Profile file of this one orientation."""
    orientation: str
    """'+x' … '-z'."""
    directory: Path
    devices: Sequence[str]
    imu_rate_hz: float
    seed: int
    number: int
    """0 … within the campaign."""
    time_scale: float = 0.0
    """Seconds of the chamber per second; 0: as fast as possible."""


def run_in_lock_step(plan: RunPlan, progress: Callable[[str], None] = lambda _: None) -> int:
    """Run one orientation; return the number of messages recorded."""
    with quiet_context() as context:
        nodes = _NodeRun(plan, context)
        try:
            return nodes.run(progress)
        finally:
            nodes.close()


class _Device:
    """A simulated device and the driver node that publishes for it."""

    def __init__(self, nodes: _NodeRun, name: str, number: int) -> None:
        plan = nodes.plan
        self.source = SimulatedDevice(
            name,
            seed=1000 * plan.seed + 10 * plan.number + number,
            full_scale=DEFAULT_FULL_SCALE,
            orientation=plan.orientation,
        )
        self._scale = SampleScale(DEFAULT_FULL_SCALE)
        namespace = f'/{name}'
        self.node = ImuDriverNode(
            capture=lambda topic, message: nodes.take(f'{namespace}/{topic}', topic, message),
            now=nodes.now,
            parameters={'transport': f'simulated://{name}', 'frame_id': f'{name}_imu_link'},
            namespace=namespace,
            **nodes.options,
        )
        self.node.trigger_configure()

    def publish(self, stamp: int, time_s: float, ambient_c: float) -> None:
        """Take one sample of everything and publish it."""
        gyroscope, accelerometer, magnetometer, thermometer = self.source.sample(time_s, ambient_c)
        counts = (*gyroscope, *accelerometer, *magnetometer)
        frame = DataFrame(0, 0, MAGNETOMETER_NEW | TEMPERATURE_NEW, thermometer, counts)
        self.node.publish([self._scale.sample(stamp, frame)])


class _NodeRun:
    """The nodes of one run and the clock they share."""

    def __init__(self, plan: RunPlan, context: Context) -> None:
        self.plan = plan
        self._stamp = FIRST_START_NS + plan.number * DAY_NS
        self._begin = self._stamp
        self.options: dict[str, Any] = {
            'context': context,
            'enable_rosout': False,
            'start_parameter_services': False,
        }
        self._listeners: dict[str, Callable[[Any], None]] = {}
        self._recorder = self._open_recorder()
        self.devices = [_Device(self, name, i) for i, name in enumerate(plan.devices)]
        self.chamber = ChamberProfileNode(
            capture=lambda topic, message: self.take(f'/{topic}', topic, message),
            now=self.now,
            parameters={
                'profile': str(plan.profile),
                'chamber': f'simulated?seed={4 * plan.seed + plan.number}',
                'start': True,
                'run_directory': str(plan.directory),
                'imu_topics': [f'/{name}/imu/temperature' for name in plan.devices],
            },
            **self.options,
        )
        self.chamber.get_logger().set_level(LoggingSeverity.WARN)
        if not self.chamber.autostart():
            raise CampaignError(f'the chamber node refuses: {self.chamber.refused}')
        self._listeners = self.chamber.inputs

    def now(self) -> int:
        """Return the shared clock [ns]."""
        return self._stamp

    def take(self, topic: str, name: str, message: Any) -> None:
        """Pass a published message to the recorder, and to the chamber node if it listens."""
        if topic in self._listeners:
            self._listeners[topic](message)
        if isinstance(message, bytes):
            self._record(topic, DRIVER_MESSAGE_TYPES[name], message)
        elif not name.startswith('/'):
            self._record(topic, type_of(message), message)

    def run(self, progress: Callable[[str], None]) -> int:
        """Advance the clock second by second until the run is over."""
        plan, chamber = self.plan, self.chamber
        steps = max(1, round(plan.imu_rate_hz))
        every = max(1, round(1.0 / plan.imu_rate_hz))
        second, asked, flushed = 0, 0, time.monotonic()
        began = flushed
        while chamber.exit_code is None:
            self._stamp = self._begin + second * SECOND_NS
            chamber.advance()
            if second % every == 0:
                self._sample(second, steps if plan.imu_rate_hz > 1.0 else 1)
            asked = self._confirm(asked)
            if time.monotonic() - flushed > 1.0:
                self._recorder.flush()
                flushed = time.monotonic()
                where = f'{chamber.snapshot.step.id} at {second / 3600:.1f} h'
                progress(f'{plan.directory.name}: {where}')
            if plan.time_scale:
                time.sleep(max(0.0, began + second / plan.time_scale - time.monotonic()))
            second += 1
        if chamber.snapshot.progress.mode != DONE:
            raise CampaignError(f'{plan.directory}: {chamber.snapshot.progress.reason}')
        return int(self._recorder.recorder.messages)

    def close(self) -> None:
        """Finish the bag and destroy the nodes."""
        self._recorder.deactivated()
        self._recorder.destroy_node()
        self.chamber.run.conductor.close()
        for node in (self.chamber, *(device.node for device in self.devices)):
            node.destroy_node()

    def _sample(self, second: int, count: int) -> None:
        chamber = self.chamber.run.conductor.link.chamber
        assert isinstance(chamber, SimulatedChamber)  # noqa: S101 (the node's parameter says so)
        for i in range(count):
            self._stamp = self._begin + second * SECOND_NS + i * SECOND_NS // count
            for device in self.devices:
                device.publish(self._stamp, second + i / count, chamber.true_air)

    def _confirm(self, asked: int) -> int:
        """Confirm an operator prompt after the time the profile expects."""
        snapshot = self.chamber.snapshot
        if snapshot.progress.stage != CONFIRM or snapshot.step.phase != OPERATOR_PHASE:
            return 0
        if asked and self._stamp - asked >= snapshot.step.expected_s * SECOND_NS:
            self.chamber.command('confirm')
        return asked or self._stamp

    def _open_recorder(self) -> RecorderNode:
        plan = self.plan
        recorder = RecorderNode(
            capture=lambda *_: None,
            now=self.now,
            parameters={
                'output': str(plan.directory),
                'run': plan.directory.name,
                'metadata': [f'simulated={SIMULATOR}'],
            },
            **self.options,
        )
        recorder.trigger_configure()
        if recorder.refused:
            raise CampaignError(f'the recorder refuses: {recorder.refused}')
        return recorder

    def _record(self, topic: str, message_type: str, message: Any) -> None:
        """Hand a message to the recorder, serialised, if it records the topic."""
        recorder = self._recorder
        if message_type == STRING and topic == f'/{RUN_TOPIC}':
            recorder.inputs[RUN_TOPIC](message)
        if topic not in recorder.inputs:
            if not recorder.recorder.needs(topic):
                return
            recorder.subscribe(topic, message_type)
        recorder.inputs[topic](message if isinstance(message, bytes) else serialise(message))
