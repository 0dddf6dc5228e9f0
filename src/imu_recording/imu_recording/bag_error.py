# SPDX-License-Identifier: Apache-2.0
"""What reading and writing bags raise."""

from imu_recording.recording import RecordingError


class BagError(RecordingError):
    """A bag that cannot be read or written; the message names the file and a way out."""
