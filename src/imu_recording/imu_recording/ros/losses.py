# SPDX-License-Identifier: Apache-2.0
"""Losses of a node: messages the middleware dropped, and samples missing between stamps."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from difflib import get_close_matches
from statistics import median
from typing import Any

from imu_recording.ros.diagnostics import Status

LEAST_STEPS = 20
"""Number of steps that tell the interval of the stamps; as many longer ones are a new rate."""
LONGEST_GAP_NS = 10_000_000_000
"""Longest step that is a loss; a longer one is a pause of the source [ns]."""
LONG_STEP_RATIO = 1.5
"""Ratio of a step to the interval from which samples are missing."""
REMEMBERED_CALLS = 10
"""Number of calls, one a second, for which a loss is a warning."""


class StampGaps:
    """Counts the samples missing in a series of stamps against their nominal interval.

    Irregular stamps, of a driver that stamps samples on arrival, have none.

    >>> gaps = StampGaps()
    >>> for stamp in [*range(0, 300, 10), 330, 340]:
    ...     gaps.add(stamp)
    >>> gaps.missing
    3
    """

    def __init__(self) -> None:
        self.missing = 0
        self._last = -1
        self._interval = 0.0
        self._steps: list[int] = []
        self._longer = 0
        """Samples counted as missing in the present row of long steps."""

    def add(self, stamp: int) -> None:
        """Take in the stamp of a sample [ns]."""
        step, self._last = stamp - self._last if self._last >= 0 else 0, stamp
        if not 0 < step < LONGEST_GAP_NS:
            return
        if self._interval and step <= LONG_STEP_RATIO * self._interval:
            if self._steps:
                self._steps, self._longer = [], 0
            return
        self._steps.append(step)
        if self._interval:
            lost = round(step / self._interval) - 1
            self.missing += lost
            self._longer += lost
        if len(self._steps) >= LEAST_STEPS:  # known now, or another rate: nothing was missing
            self._interval = _regular_interval(self._steps)
            self.missing -= self._longer
            self._steps, self._longer = [], 0


def _regular_interval(steps: list[int]) -> float:
    """Return the median step; 0 where more than a tenth of the steps are far from it."""
    middle = median(steps)
    far = sum(not middle / LONG_STEP_RATIO <= step <= LONG_STEP_RATIO * middle for step in steps)
    return middle if 10 * far <= len(steps) else 0.0


class Losses:
    """Losses of a node by topic."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = Counter()
        """Messages the middleware says were lost on their way to this node."""
        self.gaps: dict[str, StampGaps] = {}
        self._past: deque[tuple[int, int]] = deque(maxlen=REMEMBERED_CALLS)

    def gaps_of(self, topic: str) -> StampGaps:
        """Return the counter of a topic's stamps."""
        return self.gaps.setdefault(topic, StampGaps())

    def by_topic(self) -> dict[str, int]:
        """Return how many messages of each topic are known to be missing."""
        missing = {topic: gaps.missing for topic, gaps in self.gaps.items()}
        every = {t: max(missing.get(t, 0), self.dropped[t]) for t in {*missing, *self.dropped}}
        return {topic: number for topic, number in sorted(every.items()) if number}

    def applied(self, status: Status) -> Status:
        """Return the status with the counts; a warning while they have risen of late."""
        level, line, values = status
        now = sum(self.dropped.values()), sum(gaps.missing for gaps in self.gaps.values())
        before = self._past[0] if self._past else (0, 0)
        self._past.append(now)
        counted: dict[str, Any] = {'messages_dropped': now[0], 'samples_missing': now[1]}
        rises = [
            f'{new - old} {word}'
            for new, old, word in zip(
                now, before, ('messages dropped', 'samples missing'), strict=True
            )
            if new > old
        ]
        if rises:
            lost = f'{", ".join(rises)} in the last {REMEMBERED_CALLS} s'
            level, line = max(level, 1), f'{lost}; {line}'
        return level, line, values | counted


def nothing_heard(topic: str, publishers: int, others: Iterable[str]) -> str:
    """Return why nothing may have come on a topic; `others` are topics of its type that exist.

    >>> nothing_heard('/imu/data_raw', 0, ['/imu/data_row', '/camera/imu'])
    '/imu/data_raw has no publisher; /imu/data_row has'
    """
    if publishers:
        return f'{topic} has a publisher, but no message came'
    others = list(others)
    near = get_close_matches(topic, others, 3, 0.6) or others[:3]
    return f'{topic} has no publisher' + (f'; {", ".join(near)} has' if near else '')
