# SPDX-License-Identifier: Apache-2.0
"""What the chamber was told, whether it does it, and what it must be told next. No I/O."""

from __future__ import annotations

from dataclasses import dataclass

from chamber_profile.profile import Limits
from chamber_profile.sequence_types import LINK_OK, Action, Readings, Switch, WriteSetpoint
from chamber_profile.setpoint_program import Heading, SetpointWriter

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
