# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of shape parameters, from the change of the error over one standard deviation.

A derivative at a point would do for a lag. But a step moves from row to row, a spectral line turns
by whole periods over a hundredth of its range, and a poorly determined parameter acts nonlinearly:
a secant is taken, as wide as the standard deviation that follows from it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.shape_search import ShapeScale, shape_scales, shape_values, with_shape
from thermal_comp.fitting.weights import solved
from thermal_comp.linear.design import Design, Term
from thermal_comp.linear.normal_equations import Solution

FIRST_HALF_SECANT, WIDEST_HALF_SECANT = 0.01, 0.1
"""Half of a secant, as a share of the range that is searched: at first, and at most."""
LARGEST_WIDTH_RATIO = 1.5
"""Ratio between the half secants of two rounds up to which they count as equal."""
MOST_ROUNDS = 6
"""Rounds in which secants are adapted, at most."""
SURFACE_CHANNEL = 'device_temperature'
"""Thermometer of the surface on which water freezes."""
SURFACE_STD_K = 0.3
"""Standard deviation of the surface's temperature about that thermometer [K]."""
UNIFORM_HALF_WIDTH = 3.0**0.5
"""Half width of a uniform distribution, in standard deviations."""


@dataclass(frozen=True)
class ShapeDirection(Effect):
    """Column of a shape parameter: how the modelled error changes with it."""

    name: ClassVar[str] = 'shape'
    coupled: ClassVar[bool] = True
    of: str = ''
    """Name of the effect, with @ and a sensor where it acts on one."""
    parameter: str = ''
    place: int = 0


@dataclass(frozen=True, eq=False)
class Secant:
    """A shape parameter and the secant along it."""

    term: Term
    scales: list[ShapeScale]
    k: int
    """Number of the parameter among the scales of the effect."""
    width: float
    """Half of the secant, on the search scale."""
    least: float
    """Least such half over which the error changes at all, on the search scale."""

    @property
    def column(self) -> ShapeDirection:
        """The effect that stands for it in a design."""
        sensors = self.term.sensors
        place = f'@{sensors[0]}' if len(sensors) == 1 else ''
        scale = self.scales[self.k]
        return ShapeDirection(f'{self.term.effect.name}{place}', scale.name, scale.place or 0)

    @property
    def value(self) -> float:
        """The parameter's value on the search scale."""
        return float(shape_values(self.term.effect, self.scales)[self.k])

    def moved(self, by: float) -> Effect:
        """Return the effect with the parameter moved on the search scale."""
        values = shape_values(self.term.effect, self.scales)
        values[self.k] += by
        return with_shape(self.term.effect, self.scales, values)

    def on_scale(self, std: float) -> float:
        """Return a standard deviation on the search scale."""
        scale = self.scales[self.k]
        return std / scale.back(self.value) if scale.logarithmic else std

    def fitted(self, std: float) -> Secant:
        """Return the secant with half of it as wide as a standard deviation, within bounds."""
        grid = self.scales[self.k].grid()
        most = WIDEST_HALF_SECANT * float(grid[-1] - grid[0])
        return replace(self, width=min(max(self.on_scale(std), self.least), most))


def solve_with_shapes(design: Design, estimate: FloatArray) -> tuple[Design, Solution]:
    """Return the design with a column per shape parameter, at the `estimate`, and its solution."""
    secants = _secants(design)
    if not secants:
        return design, solved(design)
    for _ in range(MOST_ROUNDS):
        wider = _with_columns(design, secants, estimate)
        solution = solved(wider)
        starts = {term.effect: term.start for term in wider.terms}
        at = [starts[d.column] for d in secants]
        std = np.sqrt(solution.covariance[at, at])
        after = [d.fitted(s) if s > 0.0 else d for d, s in zip(secants, std, strict=True)]
        ratios = [a.width / b.width for a, b in zip(after, secants, strict=True)]
        if all(1.0 / LARGEST_WIDTH_RATIO < ratio < LARGEST_WIDTH_RATIO for ratio in ratios):
            break
        secants = after
    return wider, _with_surface_error(design.terms, wider, solution, estimate)


def _with_surface_error(
    terms: Sequence[Term], design: Design, solution: Solution, estimate: FloatArray
) -> Solution:
    """Return the solution, its covariance with the uncertainty of the surface's temperature.

    `terms` are those to which the `estimate` belongs: the design has a column per shape, too.
    Water freezes at another place than the thermometer's: an offset o of known standard deviation
    is not fitted, but moves the estimates by C Xᵀ S⁻¹ (∂error/∂o) o.
    """
    covariance = solution.covariance
    for term in terms:
        if SURFACE_CHANNEL not in term.effect.optional_channels:
            continue
        column = ShapeDirection(term.effect.name, SURFACE_CHANNEL)
        raw = dict(design.raw)
        for run in range(len(design.runs)):
            ends = [_with_surface_offset(design.runs[run], sign) for sign in (-0.5, 0.5)]
            for sensor in term.sensors:
                low, high = (end.columns(term.effect, sensor) for end in ends)
                change = _weighted(high - low, term, run, estimate)
                raw[column, run, sensor] = change[:, :, None] * SURFACE_STD_K
        effects = {
            s: (*listed, column) if s in term.sensors else listed
            for s, listed in design.effects.items()
        }
        doubtful = replace(design, effects=effects, raw=raw, white=dict(design.white))
        place = next(t.start for t in doubtful.terms if t.effect == column)
        shared = np.delete(doubtful.weighted.equations().gram[:, place], place)
        moved = solution.response @ shared
        covariance = covariance + np.outer(moved, moved)
    return replace(solution, covariance=covariance)


def _with_surface_offset(run: PreparedRun, offset: float) -> PreparedRun:
    """Return the run with its surface `offset` [K] warmer than it was measured."""
    conditions = run.conditions
    surface = conditions.device_temperature
    if surface is None:
        return replace(
            run, conditions=replace(conditions, temperature=conditions.temperature + offset)
        )
    return replace(run, conditions=replace(conditions, device_temperature=surface + offset))


def resolution_std(design: Design, column: ShapeDirection) -> float:
    """Return the standard deviation below which no data determine a parameter; mostly zero.

    The time of an event is known to a row and a half, as rows may be stamped at either end of
    their interval; the frequency of a spectral line to a radian over a run, as the clock that
    paces the samples wanders.
    """
    secant = next(d for d in _secants(design) if d.column == column)
    scale = secant.scales[secant.k]
    if scale.unit == 'Hz':
        return scale.back(secant.value) * secant.least / UNIFORM_HALF_WIDTH
    return 1.5 * secant.least / UNIFORM_HALF_WIDTH if _by_rows(design, secant) else 0.0


def _secants(design: Design) -> list[Secant]:
    duration = max(float(run.time[-1]) for run in design.runs)
    row = max(float(np.median(np.diff(run.conditions.time))) for run in design.runs)
    found = []
    for term in design.terms:
        scales = shape_scales(term.effect, duration)
        for k, scale in enumerate(scales):
            span = float(scale.grid()[-1] - scale.grid()[0])
            start = Secant(
                term=term, scales=scales, k=k, width=FIRST_HALF_SECANT * span, least=1e-9 * span
            )
            if scale.unit == 'Hz':
                least = start.on_scale(1.0 / (2.0 * np.pi * duration))
                start = replace(start, least=least)
            elif _by_rows(design, start):
                start = replace(start, least=row)
            found.append(start)
    return found


def _by_rows(design: Design, secant: Secant) -> bool:
    """Tell whether rows limit the parameter: it is a time, or a small change has no effect."""
    scale = secant.scales[secant.k]
    if scale.logarithmic:
        return False
    if scale.unit == 's':
        return True
    sensor = secant.term.sensors[0]
    little = 1e-7 * secant.width
    ends = [secant.moved(by) for by in (-little, little)]
    low, high = ([run.columns(effect, sensor) for run in design.runs] for effect in ends)
    return all(np.array_equal(*pair) for pair in zip(low, high, strict=True))


def _with_columns(design: Design, secants: list[Secant], estimate: FloatArray) -> Design:
    added: dict[Sensor, list[Effect]] = {sensor: [] for sensor in design.sensors}
    raw = dict(design.raw)
    for secant in secants:
        column = secant.column
        ends = [secant.moved(by) for by in (-secant.width, secant.width)]
        scale = secant.scales[secant.k]
        low, high = (scale.back(shape_values(end, secant.scales)[secant.k]) for end in ends)
        for sensor in secant.term.sensors:
            added[sensor].append(column)
            for run in range(len(design.runs)):
                change = _change(design, secant.term, ends, (run, sensor), estimate)
                raw[column, run, sensor] = (change / (high - low))[:, :, None]
    effects = {sensor: (*design.effects[sensor], *added[sensor]) for sensor in design.sensors}
    return replace(design, effects=effects, raw=raw, white=dict(design.white))


def _change(
    design: Design,
    term: Term,
    ends: list[Effect],
    piece: tuple[int, Sensor],
    estimate: FloatArray,
) -> FloatArray:
    """Return the (m, 3) change of the error of one run and sensor from one form to the other."""
    run, sensor = piece
    low, high = (design.runs[run].columns(end, sensor) for end in ends)
    return _weighted(high - low, term, run, estimate)


def _weighted(columns: FloatArray, term: Term, run: int, estimate: FloatArray) -> FloatArray:
    """Return the (m, 3) error of columns of a term times its coefficients."""
    total = np.zeros((len(columns), 3))
    for axis in range(3):
        part = columns[:, axis] if columns.ndim == 3 else columns
        total[:, axis] = part @ estimate[term.indices(run, axis, part.shape[1])]
    return total
