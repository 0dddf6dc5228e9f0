# SPDX-License-Identifier: Apache-2.0
"""Faults of an emulated chamber, as a command line gives them: NAME@SECONDS[+DURATION]."""

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
    'operator_stop': 'STOP is pressed at the panel',
}
"""Name → effect."""

DISCONNECT_S = 2.0
_PATTERN = re.compile(r'^([a-z_]+)@(\d+(?:\.\d+)?)(?:\+(\d+(?:\.\d+)?))?$')
_ALARM_CODE = '4'


@dataclass(frozen=True)
class Fault:
    """A fault from `start_s` for `duration_s`, in seconds of the host since the first contact."""

    name: str
    start_s: float
    duration_s: float = math.inf

    def active(self, now: float) -> bool:
        """Return whether the fault is active now."""
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
    """The faults over time; those of the chamber itself are applied to the plant."""

    def __init__(self, faults: list[Fault], plant: EmulatedPlant) -> None:
        self._faults = faults
        self._plant = plant
        self._stopped: set[Fault] = set()

    def active_at(self, now: float) -> set[str]:
        """Apply the plant's faults and return the names of all active ones."""
        active = {fault.name for fault in self._faults if fault.active(now)}
        names = {fault.name for fault in self._faults}
        chamber = self._plant.chamber
        self._plant.refuses = 'refusals' in active
        if 'stuck_compressor' in names:
            self._plant.stick_compressor(stuck='stuck_compressor' in active)
        if 'alarms' in active:
            chamber.alarms = (_ALARM_CODE,)
        elif chamber.alarms == (_ALARM_CODE,):
            chamber.alarms = ()
        for fault in self._faults:
            if fault.name == 'operator_stop' and fault.active(now) and fault not in self._stopped:
                self._stopped.add(fault)
                chamber.stop()
        return active


def damaged(answer: bytes, active: set[str]) -> bytes:
    """Return the bytes of an answer that are sent under the active faults."""
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
