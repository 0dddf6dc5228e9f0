# SPDX-License-Identifier: Apache-2.0
"""What reading and writing bags raise."""

from imu_recording.recording import RecordingError

LONGEST = 1000
"""A message is one line of at most this many characters."""


class BagError(RecordingError):
    """A bag that cannot be read or written; the message names the file and a way out."""

    def __init__(self, message: str) -> None:
        super().__init__(' '.join(message.splitlines())[:LONGEST])  # damaged names hold anything
