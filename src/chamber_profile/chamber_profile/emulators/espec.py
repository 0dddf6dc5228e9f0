# SPDX-License-Identifier: Apache-2.0
"""An ESPEC controller's answers, line by line."""

from __future__ import annotations

import re
from collections.abc import Callable

from chamber_profile.chambers.chamber import ChamberRefusalError
from chamber_profile.chambers.espec import LINE_END
from chamber_profile.emulators.plant import EmulatedPlant

_SETTING = re.compile(r'([SHL])\s*(-?\d+(?:\.\d+)?)')


class EspecServer:
    """Answers one line per line received."""

    def __init__(self, plant: EmulatedPlant, address: int = 0) -> None:
        self._plant = plant
        self._prefix = f'{address},' if address else ''
        self._pending = b''

    def feed(self, data: bytes) -> list[bytes]:
        """Return one answer per line received; lines for other addresses get none."""
        *lines, self._pending = (self._pending + data).split(LINE_END)
        answers = []
        for line in lines:
            text = line.decode('ascii', 'replace').strip()
            if text.startswith(self._prefix):
                answers.append(self._answer(text[len(self._prefix) :]).encode('ascii') + LINE_END)
        return answers

    def _answer(self, request: str) -> str:
        queries: dict[str, Callable[[], str]] = {
            'TEMP?': self._temperatures,
            'MON?': self._monitor,
            'ALARM?': self._alarms,
            'MODE?': lambda: self._plant.mode,
            'ROM?': lambda: self._plant.identity,
            'TYPE?': lambda: 'T,T,S2,180.0',
        }
        if request in queries:
            return queries[request]()
        if request.endswith('?'):
            return 'NA:CMD ERR'
        if self._plant.refuses:
            return 'NA:PROTECT ON'
        try:
            reason = self._order(request)
        except ChamberRefusalError:
            reason = 'DATA OUT OF RANGE'
        return f'NA:{reason}' if reason else f'OK:{request}'

    def _temperatures(self) -> str:
        chamber = self._plant.chamber
        low, high = chamber.limits
        return f'{chamber.read().air:.1f},{chamber.setpoint:.1f},{high:.1f},{low:.1f}'

    def _monitor(self) -> str:
        reading = self._plant.chamber.read()
        humidity = 100.0 * (reading.humidity or 0.0)
        return f'{reading.air:.1f},{humidity:.0f},{self._plant.mode},{len(reading.alarms)}'

    def _alarms(self) -> str:
        alarms = self._plant.chamber.alarms
        codes = ['2' if not alarm.isdecimal() else alarm for alarm in alarms]
        return ','.join([str(len(codes)), *codes])

    def _order(self, request: str) -> str:
        """Carry out an order; return why it is refused, '' where it is not."""
        chamber = self._plant.chamber
        word, _, rest = (part.strip() for part in request.partition(','))
        if word == 'TEMP':
            return self._set(rest)
        if (word, rest) == ('MODE', 'CONSTANT'):
            if chamber.alarms:
                return 'CHB NOT READY'
            chamber.run()
        elif word == 'MODE' and rest in ('STANDBY', 'OFF'):
            chamber.stop()
        elif (word, rest) != ('POWER', 'ON'):
            return 'CMD ERR' if word not in ('MODE', 'POWER') else 'PARA ERR'
        return ''

    def _set(self, rest: str) -> str:
        found = {key: float(value) for key, value in _SETTING.findall(rest)}
        if not found or _SETTING.sub('', rest).strip():
            return 'PARA ERR'
        chamber = self._plant.chamber
        low, high = found.get('L', chamber.limits[0]), found.get('H', chamber.limits[1])
        if 'S' in found and not low <= found['S'] <= high:
            return 'DATA OUT OF RANGE'
        chamber.set_limits(low, high)
        if 'S' in found:
            chamber.set_temperature(found['S'])
        return ''
