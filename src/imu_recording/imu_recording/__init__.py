# SPDX-License-Identifier: Apache-2.0
"""The columnar IMU recording, bag input and output, message conversion and the recorder node.

What reads and writes bags is imported at its first use: a node that does neither starts sooner.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from imu_recording.bags.reader import bag_namespaces, read_bag
    from imu_recording.bags.writer import write_bag
    from imu_recording.recording import BagError, ImuRecording, RecordingError

__all__ = [
    'BagError',
    'ImuRecording',
    'RecordingError',
    'bag_namespaces',
    'read_bag',
    'write_bag',
]
_MODULE_OF_NAME = {
    'BagError': 'recording',
    'ImuRecording': 'recording',
    'RecordingError': 'recording',
    'bag_namespaces': 'bags.reader',
    'read_bag': 'bags.reader',
    'write_bag': 'bags.writer',
}


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF_NAME:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULE_OF_NAME[name]}'), name)
