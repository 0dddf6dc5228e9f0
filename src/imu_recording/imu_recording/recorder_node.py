# SPDX-License-Identifier: Apache-2.0
"""Records topics, a bag for each run: raw, reliable where offered, on disk every second."""

from __future__ import annotations

from functools import partial

from std_msgs.msg import String

from imu_recording.bag_error import BagError
from imu_recording.discovering_node import DiscoveringNode
from imu_recording.free_space import free_bytes
from imu_recording.recorder_config import RecorderConfig
from imu_recording.recorder_settings import output_folder, recorder_health
from imu_recording.recording import RecordingError
from imu_recording.run_node import run_node
from imu_recording.run_notice import RUN_TOPIC, parse_notice
from imu_recording.run_recorder import RunRecorder


class RecorderNode(DiscoveringNode):
    """Records topics as they appear, raw, to a bag; to one for each run a chamber announces."""

    config_class = RecorderConfig

    def __init__(self, **options):
        super().__init__('recorder', **options)

    def setup(self, config):
        """Take the folder and begin to look for topics."""
        self.recorder = RunRecorder(config, output_folder(config.output))
        self.failure = ''
        self.listen(String, RUN_TOPIC, self.on_run)
        self.every(0.5, self.discover)
        self.every(1.0, self.flush)

    def activated(self):
        """Look for topics at once."""
        self.tell()
        self.discover()

    def is_wanted(self, topic):
        """Tell whether the recording needs the topic."""
        return self.recorder.needs(topic)

    def take(self, topic, message_type, data, offered):
        """Record a message."""
        self.attempt(self.recorder.record, topic, message_type, data, self.now(), offered)

    def on_run(self, message):
        """Go on with the bag of the run that the chamber says is under way."""
        try:
            notice = parse_notice(message.data)
            self.attempt(self.recorder.follow, notice, self.now())
        except RecordingError as error:
            self.get_logger().error(str(error))
            return
        self.tell()
        self.discover()

    def tell(self):
        """Log where the recording goes."""
        folder = self.recorder.plan.folder
        self.get_logger().info(f'recording to {folder}' if folder else 'waiting for the next run')

    def attempt(self, act, *arguments):
        """Write unless writing has failed; a failure ends the recording and is reported."""
        if self.failure:
            return
        try:
            act(*arguments)
        except BagError as error:
            self.failure = str(error)
            self.get_logger().error(f'recording stopped: {error}')
            self.publish_diagnostics()

    def flush(self):
        """Put what was received on disk; wait a little for a chamber that has just appeared."""
        expecting = not self._capture and self.count_publishers(RUN_TOPIC) > 0
        self.attempt(partial(self.recorder.flush, expecting=expecting))

    def deactivated(self):
        """Close the bag."""
        self.attempt(self.recorder.close)

    def diagnostics(self):
        """Tell what is recorded, and what went wrong."""
        if not hasattr(self, 'recorder'):
            return 0, self.state, {}
        folder = self.recorder.plan.folder
        free = free_bytes(self.recorder.output)
        values = {'folder': folder or 'none', 'messages': self.recorder.messages}
        values |= {'topics': len(self.inputs), 'free_bytes': free}
        waiting = '' if folder else 'waiting for the next run'
        return *recorder_health(self.failure, self.unknown, free, waiting), values


def main():
    """Run the node."""
    return run_node(RecorderNode)
