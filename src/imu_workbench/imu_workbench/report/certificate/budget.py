# SPDX-License-Identifier: Apache-2.0
"""Uncertainty budget of one coefficient after the GUM, checked by Monte Carlo (JCGM 100, 101).

GTC propagates: every input is an uncertain number, the measurement model is written out once, and
components, combined uncertainty and effective degrees of freedom follow from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from GTC import component, dof, multiple_ureal, uncertainty, ureal
from imu_recording.recording import FloatArray, IntArray
from scipy.special import stdtrit

MONTE_CARLO_DRAWS = 20_000
COVERAGE_PROBABILITY = 0.95
"""Coverage of the interval whose factor is k95."""
Distribution = Literal['normal', 'rectangular']
Kind = Literal['offset', 'temperature', 'span', 'input']
SOURCES = (
    'thermometer calibration',
    'gradient thermometer to die',
    'reference',
    'noise',
    'repeatability',
    'run to run',
    'model form',
)
"""What every budget accounts for; a source's name begins with one of them."""


@dataclass(frozen=True)
class Input:
    """One input quantity of the measurement model; its estimate is zero."""

    source: str
    uncertainty: float
    """Standard uncertainty [`unit`]."""
    unit: str
    degrees: float = math.inf
    """Degrees of freedom."""
    kind: Kind = 'offset'
    """offset: adds to the value; temperature: an error of every temperature; span: an error of
    the difference between the ends of the temperature range [K]; input: relative error of the
    true input."""
    shape: Distribution = 'normal'
    scatter: bool = False
    """Whether it is part of one mean square with the other such inputs; `degrees` are those of
    their sum."""


@dataclass(frozen=True)
class Uncounted:
    """A source that acts on a coefficient and is not counted."""

    source: str
    word: Literal['not stated', 'not told']
    """Not stated by the laboratory, or not told by the data."""
    detail: str = ''

    def __str__(self) -> str:
        return f'{self.source} {self.word}' + (f', {self.detail}' if self.detail else '')


@dataclass(frozen=True)
class Measurand:
    """How a coefficient depends on its inputs.

    y = (x + Σ offsets − slope · Σ temperatures) / (1 + Σ spans / range)^power / (1 + Σ inputs)
    """

    value: float
    slope: float = 0.0
    """Change of the value with temperature [unit/K]."""
    span: float = math.inf
    """Range of temperature it was found over [K]."""
    power: int = 0
    """Power of 1/K in its unit; −1 where it is a difference of temperatures."""

    def of(self, inputs: Sequence[Input], values: Sequence[Any]) -> Any:
        """Return y for values of the inputs: numbers, arrays or uncertain numbers."""
        by_kind: dict[str, Any] = dict.fromkeys(get_args(Kind), 0.0)
        for item, value in zip(inputs, values, strict=True):
            by_kind[item.kind] = by_kind[item.kind] + value
        top = self.value + by_kind['offset'] - self.slope * by_kind['temperature']
        felt = (1.0 + by_kind['span'] / self.span) ** self.power * (1.0 + by_kind['input'])
        return top / felt


@dataclass(frozen=True)
class BudgetRow:
    """One line of a budget."""

    input: Input
    contribution: float
    """|sensitivity| · standard uncertainty [unit of the coefficient]."""


@dataclass(frozen=True)
class Budget:
    """A coefficient with its combined standard uncertainty and what it is made of."""

    value: float
    unit: str
    rows: tuple[BudgetRow, ...]
    combined: float
    """Combined standard uncertainty."""
    degrees: float
    """Effective degrees of freedom (Welch–Satterthwaite)."""
    uncounted: tuple[Uncounted, ...]
    others: Mapping[str, str]
    """Sources without a row: `not stated`, `not told`, `none seen` (no scatter beyond that of the
    sources before), `does not act`."""
    monte_carlo: float
    """Standard deviation of a Monte Carlo propagation of the same inputs."""

    @property
    def expanded(self) -> float:
        """U at k = 2."""
        return 2.0 * self.combined

    @property
    def coverage_factor(self) -> float:
        """Student's factor for 95 % at the effective degrees of freedom."""
        degrees = self.degrees if math.isfinite(self.degrees) else 1e9
        return float(stdtrit(degrees, 0.5 + COVERAGE_PROBABILITY / 2.0))

    @property
    def deciding(self) -> float:
        """Half-width that decides on conformity: k = 2, or k95 where that is larger."""
        return max(2.0, self.coverage_factor) * self.combined

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, shares in percent of the combined variance."""
        variance = self.combined**2
        return {
            'value': self.value,
            'unit': self.unit,
            'combined': self.combined,
            'expanded': self.expanded,
            'degrees': self.degrees,
            'coverage_factor': self.coverage_factor,
            'monte_carlo': self.monte_carlo,
            'not_included': [str(one) for one in self.uncounted],
            'others': dict(self.others),
            'rows': [
                {
                    'source': row.input.source,
                    'uncertainty': row.input.uncertainty,
                    'unit': row.input.unit,
                    'shape': row.input.shape,
                    'degrees': row.input.degrees,
                    'contribution': row.contribution,
                    'share': 100.0 * row.contribution**2 / variance if variance else 0.0,
                }
                for row in self.rows
            ],
        }


def budget_of(
    measurand: Measurand,
    unit: str,
    inputs: Sequence[Input],
    uncounted: Sequence[Uncounted] = (),
    *,
    draws: int = MONTE_CARLO_DRAWS,
    seed: int = 0,
) -> Budget:
    """Return the budget of a coefficient; inputs without uncertainty are no lines of it.

    Raises ValueError where an input has fewer degrees of freedom than one.
    """
    used = [item for item in inputs if item.uncertainty > 0.0]
    numbers = uncertain_numbers(used)
    result = measurand.of(used, numbers)
    return Budget(
        value=measurand.value,
        unit=unit,
        rows=tuple(
            BudgetRow(i, abs(component(result, x))) for i, x in zip(used, numbers, strict=True)
        ),
        combined=float(uncertainty(result)) if used else 0.0,
        degrees=float(dof(result)) if used else math.inf,
        uncounted=tuple(uncounted),
        others=without_row(inputs, uncounted),
        monte_carlo=monte_carlo(measurand, used, draws=draws, seed=seed) if used else 0.0,
    )


def without_row(inputs: Sequence[Input], uncounted: Sequence[Uncounted]) -> dict[str, str]:
    """Return a word for every source of `SOURCES` that gives no contribution.

    >>> without_row([Input('noise', 1.0, 'K')], [Uncounted('reference: tilt', 'not stated')])[
    ...     'reference: tilt'
    ... ]
    'not stated'
    """
    found: dict[str, str] = {one.source: one.word for one in uncounted}
    found |= {item.source: 'none seen' for item in inputs if not item.uncertainty > 0.0}
    named = [*found, *(item.source for item in inputs)]
    silent = [s for s in SOURCES if not any(name.startswith(s) for name in named)]
    return found | dict.fromkeys(silent, 'does not act')


def uncertain_numbers(inputs: Sequence[Input]) -> list[Any]:
    """Return an uncertain number per input; those of one mean square share its freedom."""
    numbers = [ureal(0.0, item.uncertainty, item.degrees) for item in inputs]
    parts = [k for k, item in enumerate(inputs) if item.scatter]
    if parts and math.isfinite(inputs[parts[0]].degrees):
        widths = [inputs[k].uncertainty for k in parts]
        together = multiple_ureal([0.0] * len(parts), widths, inputs[parts[0]].degrees)
        for k, number in zip(parts, together, strict=True):
            numbers[k] = number
    return numbers


def monte_carlo(measurand: Measurand, inputs: Sequence[Input], *, draws: int, seed: int) -> float:
    """Return the standard deviation of y over draws of the inputs (JCGM 101, 7)."""
    generator = np.random.default_rng(seed)
    values = [_draw(generator, item, draws) for item in inputs]
    return float(np.std(measurand.of(inputs, values), ddof=1))


def _draw(generator: np.random.Generator, item: Input, draws: int) -> FloatArray:
    if item.shape == 'rectangular':
        half = math.sqrt(3.0) * item.uncertainty
        return generator.uniform(-half, half, draws)
    return generator.normal(0.0, item.uncertainty, draws)


def scatter_inputs(
    noise: float,
    noise_degrees: float,
    values: FloatArray,
    run: IntArray,
    unit: str,
    parts: str = 'cycles',
) -> tuple[list[Input], list[Uncounted]]:
    """Return noise, repeatability over parts of runs, run to run, and what was not determined.

    Nested analysis of variance of the (k,) values of single parts in their runs (k,): each level
    counts for what it scatters beyond the one below it, so that nothing is counted twice. Their
    sum is the largest mean square, and has its degrees of freedom.
    """
    squares = [('noise', noise**2, noise_degrees)]
    missing: list[Uncounted] = []
    groups = [values[run == r] for r in np.unique(run)]
    counts = np.array([len(group) for group in groups])
    within = float(counts.sum() - len(groups))
    repeatability = f'repeatability over {parts}'
    if within > 0:
        square = sum(float(((g - g.mean()) ** 2).sum()) for g in groups) / within
        squares.append((repeatability, square / counts.sum(), within))
    else:
        missing.append(Uncounted(repeatability, 'not told', 'one alone does not tell it'))
    if len(groups) > 1:
        between = float(np.var([g.mean() for g in groups], ddof=1)) / len(groups)
        squares.append(('run to run', between, len(groups) - 1.0))
    else:
        missing.append(Uncounted('run to run', 'not told', 'no two runs tell it alone'))
    return _nested(squares, unit), missing


def _nested(squares: Sequence[tuple[str, float, float]], unit: str) -> list[Input]:
    """Return an input per level: what its mean square exceeds the largest below it by.

    The levels add up to the largest mean square, so that each has its degrees of freedom.
    """
    widths, known, degrees = [], 0.0, math.inf
    for _, square, own in squares:
        widths.append(math.sqrt(max(0.0, square - known)))
        if square > known:
            known, degrees = square, own
    return [
        Input(source, width, unit, degrees, scatter=True)
        for (source, _, _), width in zip(squares, widths, strict=True)
    ]
