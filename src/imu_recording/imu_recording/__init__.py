# SPDX-License-Identifier: Apache-2.0
"""The columnar IMU recording, bag input and output, message conversion and the recorder node."""

from imu_recording.bag_error import BagError
from imu_recording.bag_reader import bag_namespaces, read_bag
from imu_recording.bag_writer import write_bag
from imu_recording.recording import ImuRecording, RecordingError

__all__ = [
    'BagError',
    'ImuRecording',
    'RecordingError',
    'bag_namespaces',
    'read_bag',
    'write_bag',
]
