# SPDX-License-Identifier: Apache-2.0
"""Faults an emulated chamber can have: NAME@SECONDS[+DURATION]."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from imu_recording.user_error import UserError

from chamber_profile.emulators.plant import EmulatedPlant

FAULTS = {
    'silence': 'requests get no answer',
    'garbage': 'answers are random bytes',
    'half_line': 'answers stop half-way',
    'bad_crc': 'a bit of every answer is wrong',
    'refusals': 'orders are refused, queries are answered',
    'alarms': 'the chamber reports an alarm',
    'disconnect': 'the connection is closed; for 2 s no new one is accepted',
    'stuck_compressor': 'the compressor does not cool',
    'operator_stop': 'someone presses STOP at the panel',
}
"""Name → what happens."""

DISCONNECT_S = 2.0
_PATTERN = re.compile(r'^([a-z_]+)@(\d+(?:\.\d+)?)(?:\+(\d+(?:\.\d+)?))?$')
_ALARM = '4'


@dataclass(frozen=True)
class Fault:
    """A fault from `start_s` for `duration_s`, in seconds of the host since the first contact."""

    name: str
    start_s: float
    duration_s: float = math.inf

    def active(self, now: float) -> bool:
        """Return whether it acts now."""
        return self.start_s <= now < self.start_s + self.duration_s


def parse_fault(text: str) -> Fault:
    """Return the fault of a command-line argument.

    >>> parse_fault('silence@10+5')
    Fault(name='silence', start_s=10.0, duration_s=5.0)
    """
    match = _PATTERN.match(text.replace('-', '_'))
    if not match or match[1] not in FAULTS:
        raise UserError(f'--fault {text}: expected NAME@SECONDS, NAME one of {", ".join(FAULTS)}')
    name, start, duration = match.groups()
    default = DISCONNECT_S if name == 'disconnect' else math.inf
    return Fault(name, float(start), float(duration) if duration else default)


class FaultPlan:
    """Which faults act now; those of the chamber itself are applied to its body."""

    def __init__(self, faults: list[Fault], body: EmulatedPlant) -> None:
        self._faults = faults
        self._body = body
        self._stopped: set[Fault] = set()

    def look(self, now: float) -> set[str]:
        """Apply what is due and return the names of the active faults."""
        active = {fault.name for fault in self._faults if fault.active(now)}
        names = {fault.name for fault in self._faults}
        chamber = self._body.chamber
        self._body.refuses = 'refusals' in active
        if 'stuck_compressor' in names:
            self._body.stick_compressor(stuck='stuck_compressor' in active)
        if 'alarms' in active:
            chamber.alarms = (_ALARM,)
        elif chamber.alarms == (_ALARM,):
            chamber.alarms = ()
        for fault in self._faults:
            if fault.name == 'operator_stop' and fault.active(now) and fault not in self._stopped:
                self._stopped.add(fault)
                chamber.stop()
        return active


def damaged(answer: bytes, active: set[str]) -> bytes:
    """Return what of an answer goes over the wire under the active faults."""
    if 'silence' in active:
        return b''
    if 'garbage' in active:
        return bytes((37 * i + 101) % 251 for i in range(len(answer) + 3)) + b'\r\n'
    if 'half_line' in active:
        return answer[: len(answer) // 2]
    if 'bad_crc' in active and answer:
        place = len(answer) // 2
        return answer[:place] + bytes([answer[place] ^ 0x80]) + answer[place + 1 :]
    return answer
