# SPDX-License-Identifier: Apache-2.0
"""Forms of an error over temperature: a curve, a lag beside it, or an element that lags on it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect, State
from thermal_comp.effects.empirical_term import POLYNOMIAL_DEGREES, Empirical
from thermal_comp.effects.thermal_lag import ThermalLag

COARSE_LAGS = tuple(ThermalLag(10.0 * 2.0**k) for k in range(7))
"""Lags of 10 s to 640 s that are tried first: package to enclosure."""
FINE_LAG_STEP = 2.0**0.25
"""Ratio of the finer lags that are tried about the likeliest."""
CURVE_SIZE = 1 + len(POLYNOMIAL_DEGREES)
"""Coefficients of an axis: the line and the polynomials of `empirical_term`; a lag comes last."""
LAG_SIZE = 3
"""Coefficients of an axis for a lag: its own, and the two of `_SteeperLag`."""


@dataclass(frozen=True)
class CurveForm:
    """How the error depends on temperature: a curve, and which lag there is."""

    lag: ThermalLag | None = None
    tied: bool = False
    """Whether the element follows the same curve at its own, lagging temperature; else the lag is
    a term beside the curve."""

    def effects(self, line: BiasTemperature, bends: Empirical) -> tuple[Effect, ...]:
        """Return the effects that are fitted, line and bends first."""
        if self.lag is None:
            return line, bends
        if self.tied:
            return _Behind(line, self.lag), _Behind(bends, self.lag)
        return line, bends, self.lag, _SteeperLag(self.lag, bends)

    @property
    def coefficients(self) -> int:
        """Number of coefficients of an axis."""
        return CURVE_SIZE if self.lag is None or self.tied else CURVE_SIZE + LAG_SIZE


def forms_near(best: CurveForm) -> list[CurveForm]:
    """Return forms with lags about the likeliest one."""
    seconds = (best.lag or COARSE_LAGS[0]).time_constant * FINE_LAG_STEP ** np.arange(-3.0, 4.0)
    lags = [ThermalLag(float(s)) for s in seconds if s >= COARSE_LAGS[0].time_constant]
    return [CurveForm(lag, tied) for lag in lags for tied in (False, True)]


@dataclass(frozen=True)
class _Behind(Effect):
    """An effect of the temperature of an element that lags behind the thermometer."""

    effect: Effect = field(default_factory=BiasTemperature)
    lag: ThermalLag = field(default_factory=ThermalLag)

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return the columns at the lagged temperature, of `Empirical` the polynomials."""
        behind, after = self.lag.columns(conditions, state)
        temperature = conditions.temperature + behind[:, 0]
        columns, _ = self.effect.columns(replace(conditions, temperature=temperature))
        return columns[:, : len(POLYNOMIAL_DEGREES)], after


@dataclass(frozen=True)
class _SteeperLag(Effect):
    """A lag that is larger where the curve is steeper: it stands beside a lag, never in a model.

    error = (b · x + c · x²) (T_lag − T),  x as of the bends: to first order, an element that
    follows its own temperature on a curve of any form.
    """

    lag: ThermalLag = field(default_factory=ThermalLag)
    over: Empirical = field(default_factory=Empirical)

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 2) [K]."""
        behind, after = self.lag.columns(conditions, state)
        x = (conditions.temperature - self.over.middle) / self.over.half_range
        return behind * np.stack([x, x * x], axis=1), after
