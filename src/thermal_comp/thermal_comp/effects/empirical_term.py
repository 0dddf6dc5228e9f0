# SPDX-License-Identifier: Apache-2.0
"""A smooth function of temperature and its history, for errors whose cause is undecided."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError
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
BUMPS = tuple(np.linspace(-1.0, 1.0, 15).tolist())
"""Middles of bumps over x [1], for what no polynomial follows."""
BUMP_RADIUS = 0.3
"""Distance r from its middle c at which a bump (1 − ((x − c)/r)²)² ends [1]."""
LEAST_PRODUCT_LAG_S = 15.0
"""Least lag of those in products [s]: the noise of the thermometer counts twice there."""
PRODUCT_HALF_WIDTHS_K = (2.0, 8.0)
"""Half-widths of the plays in products [K] …"""
PRODUCT_DEGREES = (1, 2, 3, 4)
"""… and degrees of the polynomials that they are multiplied by."""
PRODUCT_LAGS = tuple(k for k, lag in enumerate(LAGS_S) if lag >= LEAST_PRODUCT_LAG_S)
"""Places of the lags in products."""


class Group(IntEnum):
    """Groups of columns, whose coefficients have one prior; the first four are the plain ones."""

    CURVES = 0
    """Legendre polynomials in temperature."""
    LAGS = 1
    """First-order lags behind the temperature."""
    BRANCHES = 2
    """Plays behind the temperature (hysteresis)."""
    DECAYS = 3
    """Exponentials since power-on."""
    BUMPS = 4
    """Functions of temperature that are zero but near their middle."""
    LAGS_BY_TEMPERATURE = 5
    """Lags times temperature."""
    SQUARED_LAGS = 6
    """Squares of lags."""
    BRANCH_CURVES = 7
    """Plays times polynomials in temperature."""


COLUMNS_BY_GROUP = {
    Group.CURVES: len(POLYNOMIAL_DEGREES),
    Group.LAGS: len(LAGS_S),
    Group.BRANCHES: len(HALF_WIDTHS_K),
    Group.DECAYS: len(DECAYS_S),
    Group.BUMPS: len(BUMPS),
    Group.LAGS_BY_TEMPERATURE: len(PRODUCT_LAGS),
    Group.SQUARED_LAGS: len(PRODUCT_LAGS),
    Group.BRANCH_CURVES: len(PRODUCT_HALF_WIDTHS_K) * len(PRODUCT_DEGREES),
}
"""Number of columns of each group."""
COLUMN_GROUPS = np.repeat([*COLUMNS_BY_GROUP], [*COLUMNS_BY_GROUP.values()])
"""(p,) group of each column."""
GROUP_COUNT = len(COLUMNS_BY_GROUP)
"""Number of groups of columns."""
PLAIN_GROUPS = int(Group.BUMPS)
"""Number of them that are no bumps and no products."""
LARGEST_SQUARED = 3.0
"""Weighted lag over the half range beyond which its square goes on as a line."""
LAG_GROUPS = frozenset({Group.LAGS, Group.LAGS_BY_TEMPERATURE, Group.SQUARED_LAGS})
PLAY_GROUPS = frozenset({Group.BRANCHES, Group.BRANCH_CURVES})
"""Groups that have a history."""
TEMPERATURE_GROUPS = frozenset(
    {Group.CURVES, Group.BUMPS, Group.LAGS_BY_TEMPERATURE, Group.BRANCH_CURVES}
)
"""Groups that need the temperature itself."""


def _lag_root(lags: FloatArray) -> FloatArray:
    """Return (l, l) the Cholesky factor of the correlation of the lags' amplitudes."""
    apart = np.subtract.outer(np.log(lags), np.log(lags)) / LAG_CORRELATION
    root: FloatArray = np.linalg.cholesky(np.exp(-0.5 * apart**2) + 1e-4 * np.eye(len(lags)))
    return root


SMOOTHNESS: FloatArray = (2.0 / np.array(POLYNOMIAL_DEGREES)) ** 2
"""How large a polynomial of each degree may be: a curve is smooth."""
LAG_WEIGHTS: FloatArray = 1.0 + ALIKE_IN_RAMPS_S / np.array(LAGS_S)
"""Weights of the lags, whose differences are small where they are fast."""
LAG_ROOT = _lag_root(np.array(LAGS_S))
"""Mixing by which independent coefficients give lags amplitudes that are alike …"""
PRODUCT_ROOT = _lag_root(np.array(LAGS_S)[list(PRODUCT_LAGS)])
"""… and those in products."""


@dataclass(frozen=True)
class Empirical(Effect):
    """A smooth, bounded, causal function of temperature and its history; cause undecided."""

    middle: float = shape_parameter(20.0, unit='°C', bounds=(-100.0, 150.0), given=True)
    half_range: float = shape_parameter(30.0, unit='K', bounds=(1.0, 150.0), given=True)
    deviations: tuple[float, ...] = shape_parameter(
        (1.0,) * 3 * GROUP_COUNT, unit='1', bounds=(0.0, 1e6), given=True
    )
    """Prior standard deviations of the coefficients: group by group, each of three axes [unit].

    Groups that are not listed are not in use.
    """

    name: ClassVar[str] = 'empirical_term'
    equation: ClassVar[str] = (
        'error = Σ a_k P_k(x) + Σ h_c Q(x − c) + Σ (b_τ + e_τ x + f_τ B_τ) B_τ + '
        'Σ (c_r + Σ g_rk P_k(x)) C_r + Σ d_τ e^(−t/τ),  x = (T − m)/h within ±1, '
        'Q(u) = (1 − (u/0.3)²)² where |u| < 0.3, B_τ = (T_τ − T)(1 + 600 s/τ)/h of T through a '
        'lag of τ, C_r = (P_r[T] − T)/h of a play of half-width r'
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

    def __post_init__(self) -> None:
        """Refuse deviations that are not three a group."""
        if len(self.deviations) % 3 or len(self.deviations) > 3 * GROUP_COUNT:
            raise UserError(
                f'empirical_term: {len(self.deviations)} deviations; give three, one an axis, for '
                f'each of up to {GROUP_COUNT} groups'
            )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, p) columns [1] of the groups in use, whose coefficients may act."""
        time, temperature = conditions.time, conditions.temperature
        used = self._groups_in_use
        lag_states, play_states = state or ((None,) * len(LAGS_S), (None,) * len(HALF_WIDTHS_K))
        x = np.clip((temperature - self.middle) / self.half_range, -1.0, 1.0)
        curve = legendre.legvander(x, POLYNOMIAL_DEGREES[-1])
        parts = {Group.CURVES: curve[:, POLYNOMIAL_DEGREES] * SMOOTHNESS}
        if used & LAG_GROUPS:
            lags = [
                follow(time, temperature, *one) for one in zip(LAGS_S, lag_states, strict=True)
            ]
            behind = np.stack([lagged - temperature for lagged, _ in lags], axis=1)
            behind *= LAG_WEIGHTS / self.half_range
            slow = behind[:, PRODUCT_LAGS]
            parts |= {
                Group.LAGS: behind @ LAG_ROOT,
                Group.LAGS_BY_TEMPERATURE: slow * x[:, None] @ PRODUCT_ROOT,
            }
            held = np.clip(slow, -LARGEST_SQUARED, LARGEST_SQUARED)
            parts[Group.SQUARED_LAGS] = slow * held @ PRODUCT_ROOT
            lag_states = tuple(after for _, after in lags)
        if used & PLAY_GROUPS:
            plays = [
                play(temperature, *one) for one in zip(HALF_WIDTHS_K, play_states, strict=True)
            ]
            branches = np.stack([branch - temperature for branch, _ in plays], axis=1)
            branches /= self.half_range
            bent = [branches[:, HALF_WIDTHS_K.index(r), None] for r in PRODUCT_HALF_WIDTHS_K]
            parts |= {
                Group.BRANCHES: branches,
                Group.BRANCH_CURVES: np.hstack([b * curve[:, PRODUCT_DEGREES] for b in bent]),
            }
            play_states = tuple(after for _, after in plays)
        if Group.DECAYS in used:
            parts[Group.DECAYS] = np.exp(-np.maximum(time, 0.0)[:, None] / np.array(DECAYS_S))
        if Group.BUMPS in used:
            away = np.clip((x[:, None] - BUMPS) / BUMP_RADIUS, -1.0, 1.0)
            parts[Group.BUMPS] = (1.0 - away**2) ** 2
        after = (lag_states, play_states) if used & (LAG_GROUPS | PLAY_GROUPS) else None
        return np.hstack([np.zeros((len(time), 0)), *(parts[g] for g in sorted(used))]), after

    @cached_property
    def _groups_in_use(self) -> frozenset[Group]:
        """Groups of which a coefficient may differ from zero."""
        per_group = np.array(self.deviations).reshape(-1, 3)
        return frozenset(map(Group, np.flatnonzero((per_group > 0.0).any(axis=1)).tolist()))

    def c_columns(self, c: CForm) -> CColumns:
        """Return polynomials, bumps, lags behind T, branches and decays, and their products.

        Their scales and the mixing of lags are taken into the coefficients.
        """
        from scipy.linalg import block_diag  # only now: nodes start without it

        t, used = c.temperature, self._groups_in_use
        middle, half_range = c.number(self.middle), c.number(self.half_range)
        x = ''
        if used & TEMPERATURE_GROUPS:
            x = c.let(c.clip(f'({t} - {middle}) / {half_range}', -1.0, 1.0))
        curve = _c_polynomials(c, x) if used & {Group.CURVES, Group.BRANCH_CURVES} else []
        parts: dict[Group, tuple[list[str], FloatArray]] = {}
        if Group.CURVES in used:
            curves = [curve[degree] for degree in POLYNOMIAL_DEGREES]
            parts[Group.CURVES] = curves, np.diag(SMOOTHNESS)
        if used & LAG_GROUPS:
            behind = [c.behind(t, lag) for lag in LAGS_S]
            scale = (LAG_WEIGHTS / self.half_range)[:, None]
            slow, bent = [behind[k] for k in PRODUCT_LAGS], scale[list(PRODUCT_LAGS)]
            limits = (LARGEST_SQUARED / bent[:, 0]).tolist()
            held = [c.clip(lag, -top, top) for lag, top in zip(slow, limits, strict=True)]
            parts[Group.LAGS] = behind, scale * LAG_ROOT
            parts[Group.LAGS_BY_TEMPERATURE] = (
                [f'{lag} * {x}' for lag in slow],
                bent * PRODUCT_ROOT,
            )
            squares = [f'{lag} * {limited}' for lag, limited in zip(slow, held, strict=True)]
            parts[Group.SQUARED_LAGS] = squares, bent**2 * PRODUCT_ROOT
        if used & PLAY_GROUPS:
            branches = [f'({c.play(t, width)} - {t})' for width in HALF_WIDTHS_K]
            parts[Group.BRANCHES] = branches, np.eye(len(branches)) / self.half_range
            if Group.BRANCH_CURVES in used:
                of = [branches[HALF_WIDTHS_K.index(width)] for width in PRODUCT_HALF_WIDTHS_K]
                products = [f'{branch} * {curve[k]}' for branch in of for k in PRODUCT_DEGREES]
                parts[Group.BRANCH_CURVES] = (
                    products,
                    np.eye(len(products)) / self.half_range,
                )
        if Group.DECAYS in used:
            since = c.let(f'({c.time} > {c.number(0.0)} ? {c.time} : {c.number(0.0)})')
            decays = [c.exp(f'-{since} / {c.number(decay)}') for decay in DECAYS_S]
            parts[Group.DECAYS] = decays, np.eye(len(decays))
        if Group.BUMPS in used:
            bumps = [_c_bump(c, x, at) for at in BUMPS]
            parts[Group.BUMPS] = bumps, np.eye(len(bumps))
        listed = [parts[group] for group in sorted(used)]
        expressions = [expression for part, _ in listed for expression in part]
        return CColumns(expressions, block_diag(*(mixing for _, mixing in listed)))

    def coefficient_deviations(self) -> FloatArray:
        """Return (p, 3) prior standard deviations of the coefficients [unit]."""
        in_use = np.isin(COLUMN_GROUPS, list(self._groups_in_use))
        return np.asarray(np.reshape(self.deviations, (-1, 3))[COLUMN_GROUPS[in_use]])


def _c_polynomials(c: CForm, x: str) -> list[str]:
    """Return the Legendre polynomials of degree 0 on, by Bonnet's recursion."""
    powers = [c.number(1.0), x]
    for k in range(1, POLYNOMIAL_DEGREES[-1]):
        up, down = c.number((2 * k + 1) / (k + 1)), c.number(k / (k + 1))
        powers.append(c.let(f'{up} * {x} * {powers[k]} - {down} * {powers[k - 1]}'))
    return powers


def _c_bump(c: CForm, x: str, middle: float) -> str:
    """Return a bump about its middle."""
    away = c.let(c.clip(f'({x} - {c.number(middle)}) / {c.number(BUMP_RADIUS)}', -1.0, 1.0))
    left = c.let(f'{c.number(1.0)} - {away} * {away}')
    return f'{left} * {left}'
