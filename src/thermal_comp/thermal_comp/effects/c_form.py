# SPDX-License-Identifier: Apache-2.0
"""The C99 form of an effect: its columns as expressions of C over signals that have a history."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from imu_recording.recording import SENSOR_FIELDS, FloatArray
from imu_recording.user_error import UserError

from thermal_comp.data.conditions import Sensor

CColumn = str | tuple[str, str, str]
"""Expression of a column with a coefficient per axis; or of each axis ('' for none), where the
axes share the coefficient."""

Kind = Literal['lag_difference', 'lag', 'play']
"""Kinds of signals, in the order in which they advance: a difference sees the lag before it."""


class CFormError(UserError):
    """An effect that cannot be written in C; the message names it and says why."""


@dataclass(frozen=True, eq=False)
class CColumns:
    """What an effect returns: expressions, and how its columns are made of them."""

    expressions: Sequence[CColumn]
    mixing: FloatArray | None = None
    """(e, p): the p columns are the e expressions times this; None: they are the columns. It is
    taken into the coefficients, so that the board does not multiply by it."""


@dataclass(frozen=True)
class Signal:
    """A quantity with a history, advanced once a sample, however many effects use it."""

    kind: Kind
    value: str
    """Expression it follows."""
    parameters: tuple[float, ...]
    """Time constant of a lag, both of a difference of lags [s]; half-width of a play in the unit
    of the value."""
    channels: tuple[str, ...]
    """Channels that have to be known; until they are, the history has not begun."""


@dataclass
class Signals:
    """The signals of all effects of a model; equal ones are kept once."""

    listed: list[Signal] = field(default_factory=list)
    channels: dict[str, int] = field(default_factory=dict)
    """Number of components of each channel that is used."""

    def output(self, signal: Signal) -> str:
        """Return the expression of a signal's output."""
        if signal not in self.listed:
            self.listed.append(signal)
        return f'{self.place(signal)}.output'

    def place(self, signal: Signal) -> str:
        """Return where the state keeps a listed signal."""
        place = [s for s in self.listed if s.kind == signal.kind].index(signal)
        return f'state->{signal.kind}[{place}]'


@dataclass
class CForm:
    """Names and operators of C of which an effect writes its columns for one sensor.

    What the operators return are expressions, to be joined with + − * / and parentheses; every
    constant goes through `number`, so that single precision stays single.
    """

    sensor: Sensor
    signals: Signals
    effect: str = ''
    """Name of the effect, for messages."""
    channels: tuple[str, ...] = ()
    """Channels it declares."""
    held: bool = False
    """True for an effect that bends: it sees the temperature held within the fitted range, and
    has to be a function of it alone."""
    locals: list[str] = field(default_factory=list)
    """Statements that `let` made, to stand before the columns."""

    @property
    def temperature(self) -> str:
        """Die temperature [°C]."""
        return 'held' if self.held else 'temperature'

    @property
    def temperature_difference(self) -> str:
        """Die temperature above the model's reference temperature [K]."""
        return f'({self.temperature} - REFERENCE_TEMPERATURE)'

    @property
    def time(self) -> str:
        """Time since the first sample [s]."""
        self._refuse_held()
        return 'elapsed'

    def true_input(self, axis: int) -> str:
        """Return what the sensor measures along an axis, in its SI unit."""
        self._refuse_held()
        return f'sample->{SENSOR_FIELDS[self.sensor]}[{axis}]'

    def specific_force(self, axis: int) -> str:
        """Return the measured specific force along an axis [m/s²]."""
        self._refuse_held()
        return f'sample->linear_acceleration[{axis}]'

    def channel(self, name: str, axis: int | None = None) -> str:
        """Return a channel the effect declares, or its component along an axis."""
        self._refuse_held()
        if name not in self.channels:
            raise CFormError(f'{self.effect}: channel {name!r} is not declared in channels')
        self.signals.channels[name] = 1 if axis is None else 3
        return f'sample->{name}' if axis is None else f'sample->{name}[{axis}]'

    def number(self, value: float) -> str:
        """Return a constant."""
        return f'REAL({float(value)!r})'

    def exp(self, expression: str) -> str:
        """Return the exponential of an expression."""
        return f'EXP({expression})'

    def clip(self, expression: str, low: float, high: float) -> str:
        """Return an expression held between two constants."""
        return f'clip({expression}, {self.number(low)}, {self.number(high)})'

    def let(self, expression: str) -> str:
        """Return a name for an expression that is used more than once."""
        name = f'v{len(self.locals)}'
        self.locals.append(f'const imu_thermal_real {name} = {expression};')
        return name

    def behind(self, value: str, time_constant: float) -> str:
        """Return by how much a first-order lag is above the value it follows.

        The state holds the difference: in single precision a slow lag would be lost in rounding.
        The lag starts settled; the value is linear between samples (`operators.follow`).
        """
        return self._signal('lag', value, time_constant)

    def behind_two(self, value: str, first: float, second: float) -> tuple[str, str]:
        """Return `behind` of a lag, and by how much a second lag is above the first.

        The difference has a state of its own: of two lags that are nearly alike, large
        coefficients take nearly all away, and single precision would keep their rounding.
        """
        return self.behind(value, first), self._signal('lag_difference', value, first, second)

    def play(self, value: str, half_width: float) -> str:
        """Return the play of a value (`operators.play`); it starts centred."""
        return self._signal('play', value, half_width)

    def _signal(self, kind: Kind, value: str, *parameters: float) -> str:
        self._refuse_held()
        if re.search(r'\bv\d+\b', value):
            raise CFormError(f'{self.effect}: a signal follows operators, no name made by `let`')
        return self.signals.output(
            Signal(kind, value, tuple(map(float, parameters)), self.channels)
        )

    def _refuse_held(self) -> None:
        if self.held:
            raise CFormError(
                f'{self.effect}: bends, so that its C form has to be a function of temperature '
                'alone'
            )
