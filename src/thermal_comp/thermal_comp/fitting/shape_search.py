# SPDX-License-Identifier: Apache-2.0
"""Variable projection: shape parameters by search, everything linear solved at each step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.spectral_lines import spectral_lines
from thermal_comp.data.time_scale import time_scale
from thermal_comp.effects.effect import Effect, shape_bounds
from thermal_comp.linear.design import Design, FreeTerm, Term

GRID_POINTS = 13
"""Points of the first search along a logarithmic parameter; linear ones have three times more."""
GRID_SWEEPS = 3
"""Rounds over all parameters, one by one, before all are refined together."""
LARGEST_LINE_CYCLES = 0.7
"""Cycles over a run by which the search may move a spectral line."""
LINE_SPAN_K = 20.0
"""Change of temperature over which its drift may move it by as much [K]."""
STAGES_THAT_MEET = 1.01
"""Ratio of two stages over the least one, up to which a fit has left them at it."""
Cost = Callable[[FloatArray], float]
"""What parameters on the search scale leave unexplained."""


@dataclass(frozen=True)
class ShapeScale:
    """One value of a shape parameter on the scale it is searched on."""

    name: str
    place: int | None
    """Index into a tuple of values; None for a single value."""
    low: float
    high: float
    logarithmic: bool
    unit: str

    def forward(self, value: float) -> float:
        """Return the value on the search scale."""
        value = min(max(value, self.low), self.high)
        return float(np.log(value)) if self.logarithmic else value

    def back(self, value: float) -> float:
        """Return the parameter's value."""
        natural = float(np.exp(value)) if self.logarithmic else float(value)
        return min(max(natural, self.low), self.high)

    def grid(self) -> FloatArray:
        """Return points on the search scale over the whole range."""
        count = GRID_POINTS if self.logarithmic else 3 * GRID_POINTS
        return np.linspace(self.forward(self.low), self.forward(self.high), count)


def shape_scales(effect: Effect, duration: float) -> list[ShapeScale]:
    """Return the search scales of an effect; times [s] end with the run's `duration`."""
    scales = []
    for item in effect.free_parameters:
        low, high = shape_bounds(item, time_scale(duration))
        if item.metadata['unit'] == 's':
            high = max(min(high, duration), 1.001 * low)
        value = getattr(effect, item.name)
        places = range(len(value)) if isinstance(value, tuple) else [None]
        log = low > 0.0 and high / low > 10.0
        unit = item.metadata['unit']
        scales += [
            ShapeScale(name=item.name, place=place, low=low, high=high, logarithmic=log, unit=unit)
            for place in places
        ]
    return scales


def shape_values(effect: Effect, scales: list[ShapeScale]) -> FloatArray:
    """Return the effect's parameters on the search scale."""
    values = []
    for scale in scales:
        value = getattr(effect, scale.name)
        values.append(scale.forward(value if scale.place is None else value[scale.place]))
    return np.array(values)


def with_shape(effect: Effect, scales: list[ShapeScale], values: FloatArray) -> Effect:
    """Return the effect with parameters given on the search scale."""
    changed: dict[str, Any] = {}
    for scale, value in zip(scales, values, strict=True):
        if scale.place is None:
            changed[scale.name] = scale.back(value)
        else:
            before = changed.get(scale.name, getattr(effect, scale.name))
            after = [*before]
            after[scale.place] = scale.back(value)
            changed[scale.name] = tuple(after)
    return replace(effect, **changed)


def bound_notes(design: Design) -> list[str]:
    """Return one sentence per limit at which the search left a shape parameter, or two stages."""
    duration = max(float(run.time[-1]) for run in design.runs)
    notes = []
    for term in design.terms:
        for scale in shape_scales(term.effect, duration):
            value = getattr(term.effect, scale.name)
            value = value if scale.place is None else value[scale.place]
            near = 1e-3 * (scale.grid()[-1] - scale.grid()[0])
            if min(abs(scale.forward(value) - end) for end in scale.grid()[[0, -1]]) <= near:
                name = f'{term.effect.name}: {scale.name}'.replace('_', ' ')
                limits = f'{scale.low:.4g} … {scale.high:.4g} {scale.unit}'.strip()
                notes.append(
                    f'{"+".join(term.sensors)}: {name} ends at {value:.4g}, the limit of its '
                    f'range {limits}: another effect may be meant'
                )
        stages = term.effect.stages
        if (stages[1:] < STAGES_THAT_MEET * term.effect.least_ratio * stages[:-1]).any():
            name = term.effect.name.replace('_', ' ')
            unit = term.effect.free_parameters[0].metadata['unit']
            values = ' and '.join(f'{value:.4g}' for value in stages)
            notes.append(
                f'{"+".join(term.sensors)}: {name}: its stages end at {values} {unit}, as near '
                'to each other as they may be: one body may follow another'
            )
    return notes


def refine_shapes(design: Design) -> Design:
    """Return the design with every shape parameter at the least whitened sum of squares."""
    duration = max(float(run.time[-1]) for run in design.runs)
    shaped = [t for t in design.terms if shape_scales(t.effect, duration)]
    for sweep in range(2 if len(shaped) > 1 else 1):
        for k in range(len(shaped)):
            design = _refine(design, shaped[k], duration, globally=sweep == 0)
            shaped = [t for t in design.terms if shape_scales(t.effect, duration)]
    return design


def _refine(design: Design, term: Term, duration: float, *, globally: bool) -> Design:
    """Return the design with the shape parameters of one effect where they fit best.

    `globally` searches their whole range first, else only near the values given.
    """
    scales = shape_scales(term.effect, duration)
    cost = partial(_cost, FreeTerm.of(design, term), term.effect, scales)
    values = shape_values(term.effect, scales)
    if globally:
        values = _best_start(cost, values, scales, design, term)
    is_line = term.effect.line_frequency is not None
    if is_line:
        limits = _about_line(values, scales, duration)
    elif len(scales) == 1:
        limits = [_near(values[0], scales[0])]
    else:
        limits = [(s.grid()[0], s.grid()[-1]) for s in scales]
    best = _minimum(cost, values, limits)
    if not is_line:
        best = _by_rows(cost, best, scales)
    if cost(best) > cost(values):
        best = values
    return _exchanged(design, term, with_shape(term.effect, scales, best))


def _cost(
    free: FreeTerm, effect: Effect, scales: list[ShapeScale], values: FloatArray | float
) -> float:
    """Return the whitened sum of squares that an effect with these parameters leaves at least.

    ∞ where stages meet: coefficients that nearly cancel would stand for one stage.
    """
    shaped = with_shape(effect, scales, np.atleast_1d(values))
    return free.least_squares(shaped) if shaped.stages_are_apart else np.inf


def _minimum(cost: Cost, start: FloatArray, limits: list[tuple[float, float]]) -> FloatArray:
    """Return the parameters of least cost within limits: of one, or of several from a start."""
    from scipy.optimize import minimize, minimize_scalar

    options: dict[str, float]
    if len(limits) == 1:
        (bounds,) = limits
        options = {'xatol': 1e-4 * (bounds[1] - bounds[0])}
        found = minimize_scalar(cost, bounds=bounds, method='bounded', options=options)
        return np.array([found.x])
    options = {'maxfev': 60 * len(limits), 'xatol': 1e-3, 'fatol': 1e-2}
    return np.asarray(
        minimize(cost, start, method='Nelder-Mead', bounds=limits, options=options).x
    )


def _near(value: float, scale: ShapeScale) -> tuple[float, float]:
    """Return the range of one and a half grid steps on either side of a value."""
    grid = scale.grid()
    step = 1.5 * (grid[1] - grid[0])
    low, high = grid[[0, -1]]
    return max(value - step, low), min(value + step, high)


def _best_start(
    cost: Cost,
    values: FloatArray,
    scales: list[ShapeScale],
    design: Design,
    term: Term,
) -> FloatArray:
    """Return the best values of the whole range; of a spectral line, of the prominent ones."""
    if term.effect.line_frequency is not None:
        return min([values, *_spectral_lines(design, term, scales)], key=cost)
    for _ in range(1 if len(scales) == 1 else GRID_SWEEPS):
        for k, scale in enumerate(scales):
            values = _along(cost, values, k, scale.grid())
    return values


def _about_line(
    values: FloatArray, scales: list[ShapeScale], duration: float
) -> list[tuple[float, float]]:
    """Return how far frequency and drift of a spectral line may move, by the width of its peak.

    Its place is known from the spectrum; elsewhere another line, or none, would be fitted.
    """
    reach = {
        'Hz': LARGEST_LINE_CYCLES / duration,
        'Hz/K': LARGEST_LINE_CYCLES / (duration * LINE_SPAN_K),
    }
    limits = []
    for value, scale in zip(values, scales, strict=True):
        away, here = reach.get(scale.unit, scale.high - scale.low), scale.back(value)
        limits.append((scale.forward(here - away), scale.forward(here + away)))
    return limits


def _spectral_lines(design: Design, term: Term, scales: list[ShapeScale]) -> list[FloatArray]:
    """Return frequency and drift of the most prominent lines, on the search scale."""
    if [scale.unit for scale in scales] != ['Hz', 'Hz/K']:
        return []
    found = [line for sensor in term.sensors for line in spectral_lines(design.runs, sensor)]
    return [
        np.array([scales[0].forward(line.frequency), scales[1].forward(line.drift)])
        for line in found
    ]


def _by_rows(cost: Cost, values: FloatArray, scales: list[ShapeScale]) -> FloatArray:
    """Return the values with linear ones searched nearby, point by point.

    The cost of a step's time has stairs, as a step moves from row to row: a search for a smooth
    minimum stops on any of them.
    """
    for k, scale in enumerate(scales):
        if not scale.logarithmic:
            spacing = float(np.diff(scale.grid()[:2])[0])
            for near in (0.2, 0.02):
                nearby = values[k] + near * spacing * np.linspace(-1.0, 1.0, GRID_POINTS)
                values = _along(cost, values, k, np.clip(nearby, *scale.grid()[[0, -1]]))
    return values


def _along(cost: Cost, values: FloatArray, k: int, grid: FloatArray) -> FloatArray:
    """Return the values with number k replaced by the best on the grid, if that is better."""
    trials = [values]
    for point in grid:
        trial = values.copy()
        trial[k] = point
        trials.append(trial)
    return trials[int(np.argmin([cost(trial) for trial in trials]))]


def _exchanged(design: Design, term: Term, effect: Effect) -> Design:
    """Return the design with another form of one effect."""
    return design.with_effects(
        {
            sensor: tuple(
                effect if sensor in term.sensors and e == term.effect else e for e in listed
            )
            for sensor, listed in design.effects.items()
        }
    )
