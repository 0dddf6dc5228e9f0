# SPDX-License-Identifier: Apache-2.0
"""Which samples came, which were lost: sequence numbers of 16 bits counted in 32.

>>> count = SequenceCount()
>>> count.take(65534), count.take(65535), count.take(1)
(0, 0, 1)
>>> count.expect(65546), count.lost
(8, 9)
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

REMEMBERED: Final = 1000
"""Gaps."""

_RANGE_16 = 0xFFFF
_RANGE_32 = 0xFFFFFFFF


@dataclass
class SequenceCount:
    """Accounts for every sample the device has made."""

    received: int = 0
    lost: int = 0
    gaps: int = 0
    following: int | None = None
    """Number the next sample will have; None before the first."""
    missing: deque[range] = field(default_factory=lambda: deque(maxlen=REMEMBERED))
    """Numbers of the samples lost last."""
    _knows_32_bits: bool = False

    def take(self, number: int) -> int:
        """Count a sample by its 16-bit number; return how many were lost before it."""
        if self.following is None:
            self.following = number
        missing = (number - self.following) & _RANGE_16
        self._skip(missing)
        self.following = (self.following + missing + 1) & _RANGE_32
        self.received += 1
        return missing

    def expect(self, samples: int) -> int:
        """Take over the device's own count of samples made; return how many that says are lost.

        The count comes in its place in the stream, so every sample before it has come or will
        never come.
        """
        missing = self.behind(samples)
        self._skip(missing)
        self.following = samples
        self._knows_32_bits = True
        return missing

    def behind(self, samples: int) -> int:
        """Return how far this count is behind the device's; at least 2³¹ where it is ahead."""
        if self.following is None:
            return 0
        return (samples - self.following) & (_RANGE_32 if self._knows_32_bits else _RANGE_16)

    def has_restarted(self, samples: int) -> bool:
        """Whether the device's count is behind this one."""
        return self._knows_32_bits and self.behind(samples) > _RANGE_32 // 2

    def restart(self, following: int | None) -> None:
        """The device counts anew, from `following` or from where it happens to be (None)."""
        self.following = following
        self._knows_32_bits = following is not None

    def _skip(self, missing: int) -> None:
        if missing:
            self.gaps += 1
            self.lost += missing
            first = self.following or 0
            self.missing.append(range(first, first + missing))
