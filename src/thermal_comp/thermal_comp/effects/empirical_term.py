# SPDX-License-Identifier: Apache-2.0
"""A smooth function of temperature and its history, for errors whose cause is undecided."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray
from numpy.polynomial import legendre

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, State, shape_parameter
from thermal_comp.effects.operators import follow, play

POLYNOMIAL_DEGREES = tuple(range(2, 10))
"""Degrees of the Legendre polynomials in temperature; a line is an effect of its own."""
LAGS_S = tuple(np.geomspace(10.0, 5000.0, 10).tolist())
"""Lags [s]: from the rate of a package to an enclosure that is soaked."""
LAG_CORRELATION = 0.8
"""Change of ln τ over which the amplitudes of lags stay alike."""
ALIKE_IN_RAMPS_S = 600.0
"""A lag of τ is weighted by (1 + this / τ) [s]: in ramps of a few K/min all lags are as large."""
HALF_WIDTHS_K = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Half-widths of plays [K]."""
DECAYS_S = tuple(np.geomspace(150.0, 30_000.0, 8).tolist())
"""Time constants of decays since power-on [s]."""
COLUMN_GROUPS = np.repeat(
    np.arange(4), (len(POLYNOMIAL_DEGREES), len(LAGS_S), len(HALF_WIDTHS_K), len(DECAYS_S))
)
"""(p,) group of each column: temperature, lags, branches, time since power-on."""
GROUP_COUNT = int(COLUMN_GROUPS[-1]) + 1
"""Number of groups of columns."""


def _lag_root() -> FloatArray:
    """Return (l, l) the Cholesky factor of the correlation of the lags' amplitudes."""
    apart = np.subtract.outer(np.log(LAGS_S), np.log(LAGS_S)) / LAG_CORRELATION
    root: FloatArray = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-4 * np.eye(len(LAGS_S)))
    return root


LAG_ROOT = _lag_root()
"""Mixing by which independent coefficients give lags amplitudes that are alike."""


@dataclass(frozen=True)
class Empirical(Effect):
    """A smooth, bounded, causal function of temperature and its history; cause undecided."""

    middle: float = shape_parameter(20.0, unit='°C', bounds=(-100.0, 150.0), given=True)
    half_range: float = shape_parameter(30.0, unit='K', bounds=(1.0, 150.0), given=True)
    deviations: tuple[float, ...] = shape_parameter(
        (1.0,) * 3 * (int(COLUMN_GROUPS[-1]) + 1), unit='1', bounds=(0.0, 1e6), given=True
    )
    """Prior standard deviations of the coefficients: group by group, each of three axes [unit]."""

    name: ClassVar[str] = 'empirical_term'
    equation: ClassVar[str] = (
        'error = Σ a_k P_k(x) + Σ b_τ (T_τ − T)(1 + 600 s/τ)/h + Σ c_r (P_r[T] − T)/h + '
        'Σ d_τ e^(−t/τ),  x = (T − m)/h within ±1, T_τ = T through a lag of τ, '
        'P_r = play of half-width r'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',)
    mechanism: ClassVar[str] = (
        'None is claimed: what repeats with temperature and its history is taken out where no '
        'effect of the catalogue is decided and the error on held-out parts falls.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = (
        'bias_temperature_curvature',
        'thermal_lag_two_stage',
        'thermal_hysteresis',
        'warm_up',
    )
    separation: ClassVar[str] = (
        'It fits what any of them leaves, so it tells none of them: record what the diagnosis '
        'asks for, and an effect with a name replaces it.'
    )
    typical_size: ClassVar[str] = 'whatever the error beside a line is'
    reference: ClassVar[str] = (
        'Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006 (ch. 2.7, explicit '
        'basis functions with a Gaussian prior)'
    )
    searched: ClassVar[bool] = False
    names_cause: ClassVar[bool] = False

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 31) columns [1]: polynomials, lags, branches, decays since power-on.

        Those of a group whose coefficients are zero on every axis are zero and have no history.
        """
        time, temperature = conditions.time, conditions.temperature
        with_curves, with_lags, with_plays, with_decays = self._groups_in_use()
        lag_states, play_states = state or ((None,) * len(LAGS_S), (None,) * len(HALF_WIDTHS_K))
        parts = [np.zeros((len(time), int(width))) for width in np.bincount(COLUMN_GROUPS)]
        if with_curves:
            x = np.clip((temperature - self.middle) / self.half_range, -1.0, 1.0)
            every = legendre.legvander(x, POLYNOMIAL_DEGREES[-1])[:, POLYNOMIAL_DEGREES[0] :]
            parts[0] = every * (2.0 / np.array(POLYNOMIAL_DEGREES)) ** 2
        if with_lags:
            followed = [
                follow(time, temperature, lag, before)
                for lag, before in zip(LAGS_S, lag_states, strict=True)
            ]
            behind = np.stack([lagged - temperature for lagged, _ in followed], axis=1)
            lags = behind * (1.0 + ALIKE_IN_RAMPS_S / np.array(LAGS_S)) @ LAG_ROOT
            parts[1], lag_states = lags / self.half_range, tuple(s for _, s in followed)
        if with_plays:
            played = [
                play(temperature, width, before)
                for width, before in zip(HALF_WIDTHS_K, play_states, strict=True)
            ]
            branches = np.stack([branch - temperature for branch, _ in played], axis=1)
            parts[2], play_states = branches / self.half_range, tuple(s for _, s in played)
        if with_decays:
            parts[3] = np.exp(-np.maximum(time, 0.0)[:, None] / np.array(DECAYS_S))
        after = (lag_states, play_states) if with_lags or with_plays else None
        return np.concatenate(parts, axis=1), after

    def _groups_in_use(self) -> list[bool]:
        """Return of each group whether a coefficient may differ from zero."""
        per_group = np.array(self.deviations).reshape(-1, 3)
        return [bool(used) for used in (per_group > 0.0).any(axis=1)]

    def c_columns(self, c: CForm) -> CColumns:
        """Return polynomials, lags behind T, branches and decays; their scales are the mixing."""
        from scipy.linalg import block_diag  # only now: nodes start without it

        t = c.temperature
        with_curves, with_lags, with_plays, with_decays = self._groups_in_use()
        expressions: list[str] = []
        if with_curves:
            expressions += self._c_polynomials(c)
        if with_lags:
            expressions += [c.behind(t, lag) for lag in LAGS_S]
        if with_plays:
            expressions += [f'({c.play(t, width)} - {t})' for width in HALF_WIDTHS_K]
        if with_decays:
            since = c.let(f'({c.time} > {c.number(0.0)} ? {c.time} : {c.number(0.0)})')
            expressions += [c.exp(f'-{since} / {c.number(decay)}') for decay in DECAYS_S]
        lags = (1.0 + ALIKE_IN_RAMPS_S / np.array(LAGS_S))[:, None] * LAG_ROOT / self.half_range
        curves = np.diag((2.0 / np.array(POLYNOMIAL_DEGREES)) ** 2)
        branches = np.eye(len(HALF_WIDTHS_K)) / self.half_range
        mixing = block_diag(curves, lags, branches, np.eye(len(DECAYS_S)))
        return CColumns(expressions, mixing[np.array(self._groups_in_use())[COLUMN_GROUPS]])

    def _c_polynomials(self, c: CForm) -> list[str]:
        """Return the Legendre polynomials by Bonnet's recursion."""
        middle, half_range = c.number(self.middle), c.number(self.half_range)
        x = c.let(c.clip(f'({c.temperature} - {middle}) / {half_range}', -1.0, 1.0))
        powers = [c.number(1.0), x]
        for k in range(1, POLYNOMIAL_DEGREES[-1]):
            up, down = c.number((2 * k + 1) / (k + 1)), c.number(k / (k + 1))
            powers.append(c.let(f'{up} * {x} * {powers[k]} - {down} * {powers[k - 1]}'))
        return [powers[degree] for degree in POLYNOMIAL_DEGREES]

    def coefficient_deviations(self) -> FloatArray:
        """Return (p, 3) prior standard deviations of the coefficients [unit]."""
        return np.array(self.deviations).reshape(-1, 3)[COLUMN_GROUPS]
