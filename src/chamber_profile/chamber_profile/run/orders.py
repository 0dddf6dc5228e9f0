# SPDX-License-Identifier: Apache-2.0
"""The programmed temperature, and the orders that make the chamber follow it. No I/O."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from chamber_profile.profile.values import ProfileLimits
from chamber_profile.run.values import LINK_OK, Action, Readings, Switch, WriteSetpoint

WRITE_PERIOD_S = 5.0
"""Least time between two set-point writes: register wear, load on the bus [s]."""
JITTER_S = 0.02
"""Time by which a tick may come early and still write the set-point [s]."""


@dataclass(frozen=True)
class Ramp:
    """Target and rate of the programmed temperature."""

    target_c: float
    rate_c_per_min: float
    """0: the temperature is held."""


def advanced(setpoint: float, ramp: Ramp, seconds: float) -> float:
    """Return the programmed temperature `seconds` later [°C].

    >>> advanced(20.0, Ramp(-10.0, 2.0), 60.0), advanced(-9.9, Ramp(-10.0, 2.0), 60.0)
    (18.0, -10.0)
    """
    change = ramp.rate_c_per_min / 60.0 * seconds
    distance = ramp.target_c - setpoint
    if ramp.rate_c_per_min > 0.0 and abs(distance) <= change * (1.0 + 1e-9):
        return ramp.target_c
    return setpoint + math.copysign(change, distance)


@dataclass(frozen=True)
class SetpointWriter:
    """When which set-point is written, at the resolution of the protocol.

    Halfway between two writes the written value equals the programmed one, so that it is never
    further from the ideal ramp than rate × 2.5 s plus half the resolution.
    """

    resolution_c: float
    low_c: float
    high_c: float
    written: float | None = None
    """Set-point written last [°C]; None: unknown, to be written (again)."""
    written_at: float = -math.inf

    def unwritten(self) -> SetpointWriter:
        """Return the writer that writes again, as its last write may not have arrived."""
        return replace(self, written=None)

    def due(self, now: float, setpoint: float, ramp: Ramp) -> float | None:
        """Return the set-point to write now [°C], None where there is nothing to write."""
        if now - self.written_at < WRITE_PERIOD_S - JITTER_S:
            return None
        midway = advanced(setpoint, ramp, WRITE_PERIOD_S / 2)
        value = self._quantised(self._within_rate(midway, now, ramp))
        return None if value == self.written else value

    def after(self, now: float, value: float) -> SetpointWriter:
        """Return the writer after the value was written."""
        return replace(self, written=value, written_at=now)

    def _within_rate(self, value: float, now: float, ramp: Ramp) -> float:
        """Limit the written step to the ramp's rate, also where the direction changes."""
        if self.written is None or not ramp.rate_c_per_min:
            return value
        change = ramp.rate_c_per_min / 60.0 * (now - self.written_at)
        largest = change + self.resolution_c / 2 + 1e-6
        return min(max(value, self.written - largest), self.written + largest)

    def _quantised(self, value: float) -> float:
        steps = round(value / self.resolution_c)
        if steps * self.resolution_c > self.high_c + 1e-9:
            steps -= 1
        elif steps * self.resolution_c < self.low_c - 1e-9:
            steps += 1
        return round(steps * self.resolution_c, 6)


RESPONSE_TIMEOUT_S = 60.0
"""Time the chamber may take to start, to stop and to hold a set-point [s]."""
REPEAT_PERIOD_S = 5.0
"""An order without effect is repeated after this time [s]."""


@dataclass
class ChamberOrders:
    """The orders of one run, and whether the chamber has carried them out."""

    writer: SetpointWriter
    started: bool = False
    """Whether the chamber has confirmed that it runs."""
    timeout_factor: float = 1.0
    """Factor on RESPONSE_TIMEOUT_S: > 1 on an accelerated clock."""
    _begun_at: float = 0.0
    _switched_at: float = float('-inf')
    _mismatch_since: float | None = None

    @classmethod
    def within(
        cls, limits: ProfileLimits, resolution_c: float, timeout_factor: float
    ) -> ChamberOrders:
        """Return orders that keep to the limits."""
        writer = SetpointWriter(resolution_c, limits.air_min_c, limits.air_max_c)
        return cls(writer, timeout_factor=timeout_factor)

    def begin(self, now: float) -> None:
        """Begin to give orders: the set-point first, then the start."""
        self.rewrite_setpoint()
        self.started, self._begun_at = False, now
        self._switched_at = float('-inf')

    def rewrite_setpoint(self) -> None:
        """Write the set-point again: the last write may not have arrived."""
        self.writer = self.writer.unwritten()

    def has_written(self, setpoint: float) -> bool:
        """Return whether this set-point was the last one written."""
        written = self.writer.written
        return written is not None and abs(written - setpoint) <= 0.51 * self.writer.resolution_c

    def write_setpoint(self, now: float, setpoint: float, ramp: Ramp) -> list[Action]:
        """Return the write that is due, if one is."""
        value = self.writer.due(now, setpoint, ramp)
        if value is None:
            return []
        self.writer = self.writer.after(now, value)
        return [WriteSetpoint(value)]

    def keep_running(self, now: float, readings: Readings) -> list[Action]:
        """Start the chamber once its set-point is written; never once it has run."""
        if self.started or self.writer.written is None:
            return []
        if readings.running:
            self.started = True
            return []
        return self._switch(now, on=True)

    def keep_stopped(self, now: float, readings: Readings) -> list[Action]:
        """Stop the chamber until it reports stand-by."""
        if readings.running is False and readings.link == LINK_OK:
            return []
        return self._switch(now, on=False)

    def _switch(self, now: float, *, on: bool) -> list[Action]:
        if now - self._switched_at < REPEAT_PERIOD_S:
            return []
        self._switched_at = now
        return [Switch(on)]

    def violation(self, now: float, readings: Readings) -> str:
        """Return how the chamber deviates from its orders; '' where it follows them."""
        if not self.started:
            late = now - self._begun_at > RESPONSE_TIMEOUT_S * self.timeout_factor
            return 'the chamber does not start' if late else ''
        if readings.running is False:
            return 'the chamber was stopped at its panel'
        written, held = self.writer.written, readings.setpoint
        if written is None or held is None:
            return ''
        if abs(held - written) <= 0.75 * self.writer.resolution_c:
            self._mismatch_since = None
        elif self._mismatch_since is None:
            self._mismatch_since = now
        elif now - self._mismatch_since > RESPONSE_TIMEOUT_S * self.timeout_factor:
            return f'the chamber holds {held:g} °C instead of {written:g} °C'
        elif now - self.writer.written_at >= REPEAT_PERIOD_S:
            self.rewrite_setpoint()
        return ''
