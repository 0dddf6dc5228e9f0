# SPDX-License-Identifier: Apache-2.0
"""State of one running device, made from the messages heard of it; independent of ROS.

A listener's thread puts serialised messages in and calls `absorb` a few times a second; pages
read under the same lock. Raw and compensated samples are subtracted stamp by stamp.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from imu_recording.recording import SECOND_NS, FloatArray

from imu_workbench.web.live.topic_history import (
    MAX_RECENT_ROWS,
    Rows,
    TopicHistory,
    decoded,
)
from imu_workbench.web.live.topics import ROLES

KEPT_DOUBLES: dict[str, tuple[int, ...]] = {
    'raw': (13, 14, 15, 25, 26, 27),
    'compensated': (13, 14, 15, 25, 26, 27),
    'raw_field': (0, 1, 2),
    'compensated_field': (0, 1, 2),
    'temperature': (0,),
    'complementary': (0, 1, 2, 3),
    'ahrs': (0, 1, 2, 3),
    'setpoint': (0,),
    'air': (0,),
    'device': (0,),
}
"""Which of a message's doubles are kept."""
DIFFERENCES = {
    'difference': ('raw', 'compensated'),
    'difference_field': ('raw_field', 'compensated_field'),
}
"""Raw minus compensated: name → the two roles."""
FILTERS = ('complementary', 'ahrs')
ORIENTATION_COVARIANCE_INDEX = 4
"""Index of the double that is −1 where an Imu has no orientation (REP-145)."""


@dataclass(frozen=True)
class NodeStatus:
    """Diagnostic status of one node."""

    name: str
    level: int
    """0 ok, 1 warning, 2 error, 3 stale."""
    message: str
    values: dict[str, str] = field(default_factory=dict)
    received: float = 0.0
    """[s] by the clock of the state."""


class LiveState:
    """Everything heard of one device; `now` is a monotonic clock [s]."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self.now = now
        self.lock = threading.Lock()
        self.tracks: dict[str, TopicHistory] = {}
        self.statuses: dict[str, NodeStatus] = {}
        self.phase = ''
        self.unreadable = 0
        """Messages that could not be decoded."""
        self.restarts = 0
        """How often the stamps went back: a bag that starts again."""
        self._inbox: dict[str, deque[bytes]] = {
            name: deque(maxlen=MAX_RECENT_ROWS) for name in (*KEPT_DOUBLES, 'phase')
        }
        self._waiting: dict[str, Rows] = {}
        self._attitude: dict[str, FloatArray] = {}
        self._clear()

    def put(self, role: str, data: bytes) -> None:
        """Queue a serialised message; cheap, from any thread."""
        self._inbox[role].append(data)

    def put_status(self, status: NodeStatus) -> None:
        """Take the status of a node."""
        with self.lock:
            self.statuses[status.name] = status

    def absorb(self) -> None:
        """Decode the messages that have arrived and add them to the tracks."""
        with self.lock:
            for role in KEPT_DOUBLES:
                rows = self._arrived(role)
                if self.tracks[role].jumped_back(rows):
                    self._clear()
                    self.restarts += 1
                self.tracks[role].add(rows, self.now())
                for name, (_, second) in DIFFERENCES.items():
                    if role == second:
                        self._waiting[name] = _joined(self._waiting[name], rows)
            for name in DIFFERENCES:
                self._subtract(name)
            for data in self._emptied('phase'):
                self.phase = text_of(data)

    def forget(self, role: str) -> None:
        """Drop what was heard of a role: another topic has it now."""
        with self.lock:
            self._inbox[role].clear()
            if role == 'phase':
                self.phase = ''
                return
            self.tracks[role] = TopicHistory(len(KEPT_DOUBLES[role]))
            for name, pair in DIFFERENCES.items():
                if role in pair:
                    self.tracks[name] = TopicHistory(len(KEPT_DOUBLES[role]))
                    self._waiting[name] = Rows.none(len(KEPT_DOUBLES[role]))

    def _clear(self) -> None:
        self.tracks = {role: TopicHistory(len(columns)) for role, columns in KEPT_DOUBLES.items()}
        for name, (first, _) in DIFFERENCES.items():
            self.tracks[name] = TopicHistory(len(KEPT_DOUBLES[first]))
            self._waiting[name] = Rows.none(len(KEPT_DOUBLES[first]))

    def _emptied(self, role: str) -> list[bytes]:
        inbox = self._inbox[role]
        return [inbox.popleft() for _ in range(len(inbox))]

    def _arrived(self, role: str) -> Rows:
        columns = KEPT_DOUBLES[role]
        messages = self._emptied(role)
        if not messages:
            return Rows.none(len(columns))
        rows, unreadable = decoded(ROLES[role].message_type, messages)
        self.unreadable += unreadable
        values = rows.values[:, list(columns)]
        if role in FILTERS:
            known = rows.values[:, ORIENTATION_COVARIANCE_INDEX] != -1.0
            values = np.where(known[:, None], values, np.nan)
            values = one_signed(values, self._attitude.get(role))
            finite = np.flatnonzero(np.isfinite(values).all(1))
            if len(finite):
                self._attitude[role] = values[finite[-1]]
        return Rows(rows.stamp, values)

    def _subtract(self, name: str) -> None:
        """Subtract samples of equal stamp; one without a partner is dropped after a second."""
        waiting, raw = self._waiting[name], self.tracks[DIFFERENCES[name][0]]
        if not len(waiting.stamp):
            return
        heard = raw.recent.since(int(waiting.stamp.min()))
        order = np.argsort(heard.stamp, kind='stable')
        stamp, values = heard.stamp[order], heard.values[order]
        place = np.minimum(np.searchsorted(stamp, waiting.stamp), max(len(stamp) - 1, 0))
        met = stamp[place] == waiting.stamp if len(stamp) else np.zeros(len(place), bool)
        difference = Rows(waiting.stamp[met], values[place[met]] - waiting.values[met])
        self.tracks[name].add(difference, self.now())
        rest = ~met & (waiting.stamp > raw.newest - SECOND_NS)
        self._waiting[name] = Rows(
            waiting.stamp[rest][-MAX_RECENT_ROWS:], waiting.values[rest][-MAX_RECENT_ROWS:]
        )


def text_of(data: bytes) -> str:
    """Return the text of a serialised std_msgs/String; '' where it is cut."""
    length = int.from_bytes(data[4:8], 'little')
    return data[8 : 8 + max(length - 1, 0)].decode('utf-8', 'replace')


def one_signed(quaternion: FloatArray, before: FloatArray | None) -> FloatArray:
    """Return quaternions (n, 4), each with the sign that is nearer to `before` (4,)."""
    if before is None:
        return quaternion
    return np.where((quaternion @ before)[:, None] < 0.0, -quaternion, quaternion)


def _joined(before: Rows, rows: Rows) -> Rows:
    return Rows(
        np.concatenate([before.stamp, rows.stamp]), np.concatenate([before.values, rows.values])
    )
