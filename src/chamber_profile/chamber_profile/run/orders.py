# SPDX-License-Identifier: Apache-2.0
"""The programmed temperature and the orders that make the chamber follow it. No I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from chamber_profile.profile.values import Limits
from chamber_profile.run.values import LINK_OK, Action, Readings, Switch, WriteSetpoint

WRITE_PERIOD_S = 5.0
"""Set-points are written at most so often: register wear, load on the bus [s]."""
JITTER_S = 0.02
"""… give or take a clock tick that comes a little early [s]."""


@dataclass(frozen=True)
class Heading:
    """Where the programmed temperature goes, and how fast."""

    target_c: float
    rate_c_per_min: float
    """0: it stands."""


def advanced(setpoint: float, heading: Heading, seconds: float) -> float:
    """Return the programmed temperature `seconds` later [°C].

    >>> advanced(20.0, Heading(-10.0, 2.0), 60.0), advanced(-9.9, Heading(-10.0, 2.0), 60.0)
    (18.0, -10.0)
    """
    change = heading.rate_c_per_min / 60.0 * seconds
    apart = heading.target_c - setpoint
    if heading.rate_c_per_min > 0.0 and abs(apart) <= change * (1.0 + 1e-9):
        return heading.target_c
    return setpoint + math.copysign(change, apart)


@dataclass(frozen=True)
class SetpointWriter:
    """Decides when which set-point is written, at the resolution of the protocol.

    Halfway between two writes the written value is the programmed one: it is never further from
    the ideal ramp than rate × 2.5 s plus half the resolution.
    """

    resolution_c: float
    low_c: float
    high_c: float
    written: float | None = None
    """What the chamber was last told; None: unknown, to be told (again)."""
    written_at: float = -math.inf

    def forgotten(self) -> SetpointWriter:
        """Return the writer that does not rely on its last write having arrived."""
        return replace(self, written=None)

    def due(self, now: float, setpoint: float, heading: Heading) -> float | None:
        """Return the set-point to write now [°C], None where there is nothing to write."""
        if now - self.written_at < WRITE_PERIOD_S - JITTER_S:
            return None
        ahead = advanced(setpoint, heading, WRITE_PERIOD_S / 2)
        value = self._quantised(self._within_rate(ahead, now, heading))
        return None if value == self.written else value

    def after(self, now: float, value: float) -> SetpointWriter:
        """Return the writer after the value was written."""
        return replace(self, written=value, written_at=now)

    def _within_rate(self, value: float, now: float, heading: Heading) -> float:
        """Where the way turns round, looking ahead must not make the written step too large."""
        if self.written is None or not heading.rate_c_per_min:
            return value
        passed = heading.rate_c_per_min / 60.0 * (now - self.written_at)
        most = passed + self.resolution_c / 2 + 1e-6
        return min(max(value, self.written - most), self.written + most)

    def _quantised(self, value: float) -> float:
        steps = round(value / self.resolution_c)
        if steps * self.resolution_c > self.high_c + 1e-9:
            steps -= 1
        elif steps * self.resolution_c < self.low_c - 1e-9:
            steps += 1
        return round(steps * self.resolution_c, 6)


OBEDIENCE_S = 60.0
"""How long the chamber may take to do as told: start, stop, hold the set-point [s]."""
REPEAT_S = 5.0
"""An order that shows no effect is repeated after [s]."""


@dataclass
class ChamberOrders:
    """The orders of one run. An order that was lost shows as a failing link and is repeated."""

    writer: SetpointWriter
    started: bool = False
    """Whether the chamber has confirmed that it runs as told."""
    patience: float = 1.0
    """Factor on how long the chamber may take: > 1 on an accelerated clock."""
    _wanted_at: float = 0.0
    _switched_at: float = float('-inf')
    _astray_since: float | None = None

    @classmethod
    def within(cls, limits: Limits, resolution_c: float, patience: float) -> ChamberOrders:
        """Return orders that keep to the limits."""
        writer = SetpointWriter(resolution_c, limits.air_min_c, limits.air_max_c)
        return cls(writer, patience=patience)

    def begin(self, now: float) -> None:
        """From now on the chamber shall be told its set-point and be started."""
        self.distrust()
        self.started, self._wanted_at = False, now
        self._switched_at = float('-inf')

    def distrust(self) -> None:
        """Do not rely on the last set-point having arrived."""
        self.writer = self.writer.forgotten()

    def told(self, setpoint: float) -> bool:
        """Return whether the chamber was last told this set-point."""
        written = self.writer.written
        return written is not None and abs(written - setpoint) <= 0.51 * self.writer.resolution_c

    def set_point(self, now: float, setpoint: float, heading: Heading) -> list[Action]:
        """Return the write that is due, if one is."""
        due = self.writer.due(now, setpoint, heading)
        if due is None:
            return []
        self.writer = self.writer.after(now, due)
        return [WriteSetpoint(due)]

    def keep_running(self, now: float, readings: Readings) -> list[Action]:
        """Start the chamber once it knows its set-point; one that was started is not restarted."""
        if self.started or self.writer.written is None:
            return []
        if readings.running:
            self.started = True
            return []
        return self._switch(now, on=True)

    def keep_stopped(self, now: float, readings: Readings) -> list[Action]:
        """Stop the chamber until it says that it stands by."""
        if readings.running is False and readings.link == LINK_OK:
            return []
        return self._switch(now, on=False)

    def _switch(self, now: float, *, on: bool) -> list[Action]:
        if now - self._switched_at < REPEAT_S:
            return []
        self._switched_at = now
        return [Switch(on)]

    def disobedience(self, now: float, readings: Readings) -> str:
        """Return what the chamber does although told otherwise; '' where it obeys."""
        if not self.started:
            late = now - self._wanted_at > OBEDIENCE_S * self.patience
            return 'the chamber does not start' if late else ''
        if readings.running is False:
            return 'the chamber was stopped at its panel'
        written, held = self.writer.written, readings.setpoint
        if written is None or held is None:
            return ''
        if abs(held - written) <= 0.75 * self.writer.resolution_c:
            self._astray_since = None
        elif self._astray_since is None:
            self._astray_since = now
        elif now - self._astray_since > OBEDIENCE_S * self.patience:
            return f'the chamber holds {held:g} °C instead of {written:g} °C'
        elif now - self.writer.written_at >= REPEAT_S:
            self.distrust()
        return ''
