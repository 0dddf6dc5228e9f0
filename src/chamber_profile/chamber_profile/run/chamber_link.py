# SPDX-License-Identifier: Apache-2.0
"""The link to a chamber: connects, reads and orders, retries, and reports when it is lost."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from imu_recording.user_error import UserError

from chamber_profile.chambers.chamber import Chamber, ChamberError, ChamberReading
from chamber_profile.run.values import (
    LINK_FAILING,
    LINK_LOST,
    LINK_OK,
    Action,
    Note,
    ProgramLimits,
    Readings,
    Switch,
    WriteSetpoint,
)


def carry_out(actions: Iterable[Action], chamber: Chamber, note: Callable[[Note], None]) -> None:
    """Carry out the actions in order; ChamberError from the chamber leaves the rest undone."""
    for action in actions:
        match action:
            case Note():
                note(action)
            case ProgramLimits():
                chamber.set_limits(action.low_c, action.high_c)
            case WriteSetpoint():
                chamber.set_temperature(action.temperature_c)
            case Switch(on=True):
                chamber.run()
            case Switch():
                chamber.stop()


def readings_of(time: float, reading: ChamberReading) -> Readings:
    """Return a chamber's reading as readings of the sequencer, everything else without fault."""
    return Readings(
        time=time,
        air=reading.air,
        device=reading.device,
        setpoint=reading.setpoint,
        running=reading.running,
        alarms=reading.alarms,
    )


MAX_FAILURES = 3
"""Number of failures within FAILURE_WINDOW_S from which the link is lost."""
FAILURE_WINDOW_S = 15.0
"""Window of those failures, and longest time without an answer of a link that is not lost [s of
the host]."""
RETRY_S = 5.0
"""Time between two tries of a link that failed [s of the host]."""
FIRST_RETRY_S = 1.0
"""The same before the first success, while the chamber may still be starting [s of the host]."""


class ClockError(UserError):
    """The clock is accelerated, but the chamber is not emulated."""


class ChamberLink:
    """Keeps a chamber connected. A broken link does not raise, it shows in `status`."""

    def __init__(
        self, chamber: Chamber, host: Callable[[], float], time_scale: float = 1.0
    ) -> None:
        self.chamber = chamber
        self.identity = ''
        """The chamber's description of itself; '' before it was reached."""
        self.status = LINK_FAILING
        self.fault = 'not connected yet'
        """The last failure; '' while the link works."""
        self.failures = 0
        self._host = host
        self._time_scale = time_scale
        self._recent: deque[float] = deque(maxlen=MAX_FAILURES)
        self._tried_at = self._good_at = host()
        self._retry_at = float('-inf')
        self._connected = False

    def read(self) -> ChamberReading | None:
        """Return the chamber's reading; None while the link does not work.

        Raises ClockError, before anything is ordered, where the clock is accelerated and the
        chamber does not report that it is emulated.
        """
        if self._host() < self._retry_at:
            return None
        self._tried_at = self._host()
        try:
            if not self._connected:
                self.identity = self.chamber.connect()
                self._check_clock()
                self._connected = True
            reading = self.chamber.read()
        except ChamberError as error:
            self._failed(error)
            return None
        self.status, self.fault = LINK_OK, ''
        self._good_at = self._host()
        return reading

    def carry_out(self, actions: Iterable[Action], note: Callable[[Note], None]) -> None:
        """Carry out actions in order; after an order that fails, only notes."""
        rest = list(actions)
        while rest:
            action = rest.pop(0)
            try:
                carry_out([action], self.chamber, note)
            except ChamberError as error:
                self._failed(error)
                rest = [later for later in rest if isinstance(later, Note)]

    def close(self) -> None:
        """Release the line; the chamber goes on as it is."""
        self.chamber.close()

    def _check_clock(self) -> None:
        if self._time_scale != 1.0 and not self.chamber.emulated:
            raise ClockError(
                f'time_scale is {self._time_scale:g}, but the chamber ({self.identity}) does not '
                f'say that it is emulated: only an emulated chamber may run on another clock'
            )

    def _failed(self, error: ChamberError) -> None:
        now = self._host()
        self.failures += 1
        self.fault = str(error)
        self._connected = False
        # A try counts from its beginning, so that time-outs do not stretch the window.
        self._recent.append(self._tried_at)
        self._retry_at = self._tried_at + (RETRY_S if self.identity else FIRST_RETRY_S)
        full = len(self._recent) == MAX_FAILURES
        frequent = full and self._tried_at - self._recent[0] <= FAILURE_WINDOW_S
        lost = frequent or now - self._good_at > FAILURE_WINDOW_S or self.status == LINK_LOST
        self.status = LINK_LOST if lost else LINK_FAILING
