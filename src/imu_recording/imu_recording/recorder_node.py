# SPDX-License-Identifier: Apache-2.0
"""Records topics to one bag: raw, reliable where offered, on disk every second."""

from __future__ import annotations

import shutil
from importlib import import_module

from rclpy.clock import Clock, ClockType
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from imu_recording.bag_error import BagError
from imu_recording.bag_recorder import BagRecorder
from imu_recording.lifecycle_node import ConfiguredNode
from imu_recording.recorder_config import RecorderConfig
from imu_recording.recorder_metadata import qos_profile
from imu_recording.recorder_settings import (
    is_wanted,
    output_folder,
    parse_split,
    recorder_health,
    recording_metadata,
)
from imu_recording.run_node import run_node


class RecorderNode(ConfiguredNode):
    """Subscribes to whatever matches, as it appears, and hands the bytes to a BagRecorder."""

    config_class = RecorderConfig

    def __init__(self, **options):
        super().__init__('recorder', **options)

    def setup(self, config):
        """Open the folder and begin to look for topics."""
        at_phase, size = parse_split(config.split)
        folder = output_folder(config.output)
        metadata = recording_metadata(folder, config)
        self.recorder = BagRecorder(
            folder, metadata=metadata, split_at_phase=at_phase, split_bytes=size
        )
        self.failure = ''
        self.unknown = set()
        host = Clock(clock_type=ClockType.STEADY_TIME)
        for period, act in ((0.5, self.discover), (1.0, self.flush)):
            timer = self.create_timer(period, act, clock=host)
            self._entities.append(lambda timer=timer: self.destroy_timer(timer))
        self.discover()

    def discover(self):
        """Subscribe to wanted topics that have appeared."""
        for topic, types in self.get_topic_names_and_types():
            known = topic in self.inputs or topic in self.unknown
            if known or not is_wanted(topic, self.config.topics):
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if offers:
                self.subscribe(topic, types[0], [offer.qos_profile for offer in offers])

    def subscribe(self, topic, message_type, offers=()):
        """Subscribe to the serialised messages of one topic."""
        package, _, name = message_type.split('/')
        try:
            message_class = getattr(import_module(f'{package}.msg'), name)
        except (ImportError, AttributeError):
            self.unknown.add(topic)
            self.get_logger().error(f'{topic}: type {message_type} is not installed')
            return
        qos, offered = self.matching_qos(offers)

        def on_bytes(data):
            self.attempt(self.recorder.record, topic, message_type, data, self.now(), qos=offered)

        self.input(message_class, topic, on_bytes, qos=qos, raw=True)

    def matching_qos(self, offers):
        """Return what to ask for, as strict as every publisher offers, and how to note it."""
        reliable = all(o.reliability == ReliabilityPolicy.RELIABLE for o in offers)
        latched = bool(offers) and all(
            o.durability == DurabilityPolicy.TRANSIENT_LOCAL for o in offers
        )
        qos = QoSProfile(depth=self.config.qos_depth)
        if not reliable:
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        if latched:
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
        return qos, [qos_profile(reliable=reliable, latched=latched, depth=qos.depth)]

    def attempt(self, act, *arguments, **options):
        """Write unless writing has failed; a failure ends the recording and is reported."""
        if self.failure:
            return
        try:
            act(*arguments, **options)
        except BagError as error:
            self.failure = str(error)
            self.get_logger().error(f'recording stopped: {error}')
            self.publish_diagnostics()

    def flush(self):
        """Put what was received on disk."""
        self.attempt(self.recorder.flush)

    def deactivated(self):
        """Close the bag."""
        self.attempt(self.recorder.close)

    def diagnostics(self):
        """Tell what is recorded, and what went wrong."""
        if not hasattr(self, 'recorder'):
            return 0, self.state, {}
        free = shutil.disk_usage(self.recorder.folder).free
        values = {'folder': self.recorder.folder, 'messages': self.recorder.messages}
        values |= {'topics': len(self.inputs), 'free_bytes': free}
        return *recorder_health(self.failure, self.unknown, free), values


def main():
    """Run the node."""
    return run_node(RecorderNode)
