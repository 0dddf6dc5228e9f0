# SPDX-License-Identifier: Apache-2.0
"""Pairs of IMU and magnetometer samples of one stamp, whichever arrives first.

A sample between two IMU stamps goes to the later one, as in `ImuRecording`. An IMU sample waits
for a magnetometer sample only where one of the same stamp is due, and no longer than `wait`; not
at all where magnetometer samples come before the IMU samples of their stamp (`in_order`).
"""

from __future__ import annotations

from collections import deque

from imu_recording.ros.messages import ImuSample, MagneticSample

Pair = tuple[ImuSample, MagneticSample | None]

FIRST_FIELD_WAIT_NS = 100_000_000
"""How long the first IMU samples wait for a first magnetometer sample [ns]."""
MOST_KEPT_FIELDS = 1000
"""Magnetometer samples kept for IMU samples still to come."""


class MagnetometerPairing:
    """Queues of samples that wait for their counterpart; pairs come in order of IMU stamps."""

    def __init__(
        self, *, use_magnetometer: bool = True, wait: int = 20_000_000, in_order: bool = False
    ) -> None:
        self.exact = 0
        """IMU samples that met a magnetometer sample of their stamp."""
        self.unused = 0
        """Magnetometer samples no IMU sample followed, or that came too late."""
        self._use = use_magnetometer
        self._wait = wait
        self._in_order = in_order
        self._pending: deque[ImuSample] = deque()
        self._fields: deque[MagneticSample] = deque(maxlen=MOST_KEPT_FIELDS)
        self._first_stamp: int | None = None
        self._released: int | None = None
        self._last_field: int | None = None
        self._interval = 0
        self._synchronous = True

    def add_imu(self, sample: ImuSample) -> list[Pair]:
        """Take an IMU sample; return the pairs that are complete now."""
        if not self._use:
            return [(sample, None)]
        newest = self._pending[-1].stamp if self._pending else self._released
        if newest is not None and sample.stamp <= newest:
            return self._restart(sample, newest)
        if self._first_stamp is None:
            self._first_stamp = sample.stamp
        self._pending.append(sample)
        return self._release()

    def add_field(self, sample: MagneticSample) -> list[Pair]:
        """Take a magnetometer sample; return the pairs that are complete now."""
        if self._last_field is not None and sample.stamp <= self._last_field - FIRST_FIELD_WAIT_NS:
            self._fields.clear()
            self._interval = 0
        elif self._last_field is not None and sample.stamp > self._last_field:
            self._interval = sample.stamp - self._last_field
        if (
            self._released is not None
            and self._released - FIRST_FIELD_WAIT_NS < sample.stamp <= self._released
        ):
            self.unused += 1
        else:
            self._fields.append(sample)
        self._last_field = sample.stamp
        return self._release()

    def flush(self) -> list[Pair]:
        """Return the samples that still wait: the input has ended."""
        return self._release(flush=True)

    def _restart(self, sample: ImuSample, newest: int) -> list[Pair]:
        """Pass on a sample that is not later than the last; a jump back resets the queues."""
        if sample.stamp > newest - FIRST_FIELD_WAIT_NS:
            return [*self.flush(), (sample, None)]
        pairs = self.flush()
        early = [field for field in self._fields if field.stamp <= sample.stamp]
        self._fields = deque(early, maxlen=MOST_KEPT_FIELDS)
        self._first_stamp, self._released = sample.stamp, None
        if not early:
            self._last_field = None
        self._pending.append(sample)
        return [*pairs, *self._release()]

    def _release(self, *, flush: bool = False) -> list[Pair]:
        pairs: list[Pair] = []
        while self._pending:
            head = self._pending[0]
            field = self._field_for(head)
            is_exact = field is not None and field.stamp == head.stamp
            if not (flush or is_exact) and self._is_due(head):
                break
            self._pending.popleft()
            self._released = head.stamp
            if field is not None:
                self._synchronous = is_exact
                self.exact += is_exact
            while self._fields and self._fields[0].stamp <= head.stamp:
                used = self._fields.popleft()
                self.unused += used is not field
            pairs.append((head, field))
        return pairs

    def _field_for(self, head: ImuSample) -> MagneticSample | None:
        """Return the newest magnetometer sample after the last IMU sample and up to `head`."""
        found = None
        for field in self._fields:
            if field.stamp > head.stamp:
                break
            if self._released is None or field.stamp > self._released:
                found = field
        return found

    def _is_due(self, head: ImuSample) -> bool:
        """Whether a magnetometer sample of this stamp may still come."""
        age = self._pending[-1].stamp - head.stamp
        if self._last_field is None:
            first = head.stamp if self._first_stamp is None else self._first_stamp
            return self._pending[-1].stamp - first < FIRST_FIELD_WAIT_NS
        if self._in_order or not self._synchronous or age >= self._wait:
            return False
        if self._last_field > head.stamp:
            return False
        since = head.stamp - self._last_field
        period = since if self._released is None else head.stamp - self._released
        return (
            2 * (self._interval - since) <= period and since < self._interval + FIRST_FIELD_WAIT_NS
        )
