# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of shape parameters where the equation of an effect is only nearly right.

A fit knows a time constant as well as if the lag were exactly of first order and the thermometer
had no lag of its own. Here the equation may lack something as large as a share of what it
explains: a smooth function of all that was logged, or of one variable (the discrepancy of Kennedy
and O'Hagan, Bayesian Calibration of Computer Models, 2001), or what relaxes has a second part with
time constants of its own; and the thermometer may err as in a diagnosis, which acts through all
that the model says of temperature. Each alternative has a posterior of its own over the shape
parameters of an effect, summed over a grid of values that reaches from the fit's own standard
deviation to the ends of the range that is searched. The uncertainty is the rms distance from the
fitted value under their mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import pairwise, product

import numpy as np
from imu_recording.recording import FloatArray
from scipy.interpolate import CubicSpline

from thermal_comp.data.blocks import in_search_blocks
from thermal_comp.data.conditions import SENSORS, Conditions, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import SpectralLine, spectral_lines
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import form_of
from thermal_comp.diagnosis.evidence.effect_sets import Component
from thermal_comp.diagnosis.evidence.flaws import FlexibleFunction, gain_of
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.diagnosis.evidence.set_fit import scaled
from thermal_comp.effects.effect import Effect, State
from thermal_comp.fitting.shape_search import ShapeScale, shape_scales, shape_values, with_shape
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup, ColumnSource
from thermal_comp.linear.gaussian_evidence import CoefficientPrior, joint_evidence, log_sum
from thermal_comp.model.values import SensorModel, ThermalModel

LIKELIEST_VARIABLES = 3
"""Single variables whose functions are tried as what an equation lacks."""
MOST_ALTERNATIVES = 8
"""Alternatives, second parts apart, whose posterior is summed …"""
NEGLIGIBLE_LOG_ODDS = 7.0
"""… and ln of the odds against the likeliest from which one does not count."""
LEAST_STEP_SHARE, LARGEST_STEP_SHARE = 1e-6, 0.1
"""First step of the grid of values, as a share of the range that is searched."""
SMALL_ERROR_K = 1e-3
"""Errors of the temperature by which a model's derivative is formed."""
STEP_RATIOS = (2.0, 3.0)
"""By how much each value of the grid is farther from the fitted one than the one before: of a
parameter by itself, and of two whose posterior is a joint one."""
POINTS_PER_STEP = 16
"""Points between two values of the grid at which the posterior is summed."""
MOST_JOINT_PARAMETERS = 2
"""Shape parameters of an effect whose posterior is a joint one."""


@dataclass(frozen=True, eq=False)
class ShapeCoordinate:
    """One value of a shape parameter of one component, on its search scale."""

    component: int
    scale: ShapeScale
    value: float
    step: float
    """About one standard deviation of the fit."""

    def grid(self, ratio: float) -> FloatArray:
        """Return the value and others ever farther from it, as far as the search goes."""
        low, high = self.scale.grid()[[0, -1]]
        count = int(np.ceil(np.log((high - low) / self.step) / np.log(ratio)))
        away = self.step * ratio ** np.arange(count)
        inside = [v for v in (*(self.value - away), *(self.value + away)) if low < v < high]
        values: FloatArray = np.unique([low, *inside, self.value, high])
        return values[np.diff(values, prepend=-np.inf) > 1e-3 * self.step]


@dataclass(frozen=True, eq=False)
class Alternative:
    """What may be beside the effects: the thermometer's errors, slow noise, a flaw or none."""

    log_prior: float
    priors: tuple[CoefficientPrior, ...]
    second_part: tuple[float, float] | None = None
    """Share of a second part of what relaxes, and the ratio of its time constants to the first's;
    None: it has one part."""


@dataclass(frozen=True)
class InTwoParts(Effect):
    """An effect that relaxes in two parts, each with time constants of its own.

    Equation: (1 − share) · first + share · second, the shortest distribution of relaxation times.
    """

    first: Effect
    second: Effect
    share: float
    """Of the second."""

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return the (n, …) weighted sum of both parts' columns, of a run known to its end."""
        del state
        one, other = (e.columns_in_hindsight(conditions) for e in (self.first, self.second))
        return (1.0 - self.share) * one + self.share * other, None

    def parts(self) -> tuple[Effect, ...]:
        """Return the terms of both parts, each pair as one."""
        pairs = zip(self.first.parts(), self.second.parts(), strict=True)
        return tuple(InTwoParts(one, other, self.share) for one, other in pairs)

    @classmethod
    def of(cls, effect: Effect, share: float, ratio: float) -> InTwoParts:
        """Return an effect with a second part, whose time constants are `ratio` times as long."""
        times = [s for s in shape_scales(effect, np.inf) if s.unit == 's']
        longer = np.array([s.forward(ratio * float(getattr(effect, s.name))) for s in times])
        return cls(effect, with_shape(effect, times, longer), share)


def with_model_form(
    model: ThermalModel, runs: Sequence[PreparedRun], sensors: Sequence[Sensor] = SENSORS
) -> ThermalModel:
    """Return the model, standard deviations of sensors' shape parameters with those of their form.

    Steps and spectral lines keep theirs: what limits them is a row, or a period over the run.
    """
    known = {s: model.sensors[s] for s in sensors if s in model.sensors}
    shaped = {s: part for s, part in known.items() if any(map(_form_limits, part.effects))}
    if not shaped:
        return model
    named = [
        SpectralLine(effect.line_frequency, 0.0)
        for part in shaped.values()
        for effect in part.effects
        if effect.line_frequency is not None
    ]
    lines = {sensor: spectral_lines(runs, sensor) for sensor in shaped}
    source = ColumnSource(in_search_blocks(runs, named), lines)
    widened: dict[str, SensorModel] = {s: _of_sensor(source, s, p) for s, p in shaped.items()}
    return replace(model, sensors={**model.sensors, **widened})


def _form_limits(effect: Effect) -> bool:
    """Tell whether an effect's equation may limit how well its shape parameters are known."""
    steady = not effect.repeatable and not effect.per_run and effect.line_frequency is None
    return effect.free_shapes > 0 and steady


def _of_sensor(source: ColumnSource, sensor: Sensor, part: SensorModel) -> SensorModel:
    assert part.noise is not None  # noqa: S101 (every fit has one)
    shaped = [effect for effect in part.effects if _form_limits(effect)]
    beside = [effect for effect in part.effects if not _form_limits(effect)]
    design = CandidateDesign(source, sensor, part.noise, beside)
    hypotheses = SensorHypotheses(design, {}, partial(_temperature_response, part, sensor))
    components = [
        Component(form_of(design, effect, None), float(priors.AMPLITUDES[0]), 1)
        for effect in shaped
    ]
    for place in range(len(components)):
        components, _ = scaled(hypotheses, components, place)
    coordinates = _coordinates(source.runs, components, part)
    deviations = shape_deviations(hypotheses, components, coordinates)
    total = dict(part.shape_std)
    form: dict[str, tuple[float, ...]] = {}
    for one, deviation in zip(coordinates, deviations, strict=True):
        name = f'{components[one.component].name}.{one.scale.name}'
        fitted = part.shape_std[name][one.scale.place or 0]
        further = np.sqrt(max(float(deviation) ** 2 - fitted**2, 0.0))
        form[name] = (*form.get(name, ()), float(further))
    for name, further in form.items():
        total[name] = tuple(np.hypot(part.shape_std[name], further).tolist())
    return replace(part, shape_std=total, shape_form_std=form)


def _temperature_response(
    part: SensorModel, sensor: Sensor, run: PreparedRun, errors: FloatArray
) -> FloatArray:
    """Return (m, 3, q) what small errors (n, q) of the temperature do to all a model says."""
    conditions = run.conditions.of(sensor)
    here, _ = part.modelled_error(conditions)
    changes = []
    for error in errors.T:
        small = SMALL_ERROR_K / max(float(np.abs(error).max()), SMALL_ERROR_K)
        warmer = replace(conditions, temperature=conditions.temperature + small * error)
        changes.append((part.modelled_error(warmer)[0] - here) / small)
    return run.block_mean(np.stack(changes, axis=2))


def _coordinates(
    runs: Sequence[PreparedRun], components: Sequence[Component], part: SensorModel
) -> list[ShapeCoordinate]:
    duration = max(float(run.time[-1]) for run in runs)
    found = []
    for number, component in enumerate(components):
        effect = component.form.effect
        scales = shape_scales(effect, duration)
        for scale, value in zip(scales, shape_values(effect, scales), strict=True):
            std = part.shape_std[f'{effect.name}.{scale.name}'][scale.place or 0]
            step = std / scale.back(value) if scale.logarithmic else std
            span = float(np.ptp(scale.grid()))
            step = float(np.clip(step, LEAST_STEP_SHARE * span, LARGEST_STEP_SHARE * span))
            found.append(ShapeCoordinate(number, scale, float(value), step))
    return found


def shape_deviations(
    hypotheses: SensorHypotheses,
    components: Sequence[Component],
    coordinates: Sequence[ShapeCoordinate],
) -> FloatArray:
    """Return (p,) rms deviations of shape parameters from their values, in their own units."""
    alternatives = _alternatives(hypotheses, components)
    deviations = np.zeros(len(coordinates))
    with hypotheses.design.trials():
        for together in _together(coordinates):
            grids = [coordinates[k].grid(STEP_RATIOS[len(together) - 1]) for k in together]
            scales = [coordinates[k].scale for k in together]
            component = coordinates[together[0]].component
            effect = components[component].form.effect
            forms = [with_shape(effect, scales, np.array(v)) for v in product(*grids)]
            possible = [a for a in alternatives if a.second_part is None or effect.first_order]
            table = np.array(
                [_log_posteriors(hypotheses, components, component, e, possible) for e in forms]
            )
            shape = [*(len(grid) for grid in grids), len(possible)]
            points, log_weight = _log_weights(grids, table.reshape(shape))
            values = [
                np.array([one.back(float(v)) for v in fine])
                for one, fine in zip(scales, points, strict=True)
            ]
            fitted = [
                one.back(coordinates[k].value) for k, one in zip(together, scales, strict=True)
            ]
            if len(values) > 1 and _alike(effect.parts()):
                in_order = np.greater.outer(*values) == (fitted[0] > fitted[1])
                log_weight = np.where(in_order, log_weight, -np.inf)
            share = np.exp(log_weight - log_sum(log_weight.ravel()))
            for axis, k in enumerate(together):
                others = tuple(a for a in range(share.ndim) if a != axis)
                squares = (values[axis] - fitted[axis]) ** 2
                deviations[k] = np.sqrt(share.sum(axis=others) @ squares)
    return deviations


def _log_posteriors(
    hypotheses: SensorHypotheses,
    components: Sequence[Component],
    place: int,
    effect: Effect,
    alternatives: Sequence[Alternative],
) -> FloatArray:
    """Return (a,) ln of prior times evidence of each alternative with one component's effect."""
    found = np.array([one.log_prior for one in alternatives])
    for parts in dict.fromkeys(one.second_part for one in alternatives):
        chosen = [k for k, one in enumerate(alternatives) if one.second_part == parts]
        form = effect if parts is None else InTwoParts.of(effect, *parts)
        moved = [*components]
        moved[place] = replace(moved[place], form=form_of(hypotheses.design, form, None))
        found[chosen] += _log_evidences(hypotheses, moved, [alternatives[k] for k in chosen])
    return found


def _together(coordinates: Sequence[ShapeCoordinate]) -> list[list[int]]:
    """Return the coordinates of each component, at most two together."""
    of: dict[int, list[int]] = {}
    for k, one in enumerate(coordinates):
        of.setdefault(one.component, []).append(k)
    return [
        part
        for own in of.values()
        for part in ([own] if len(own) <= MOST_JOINT_PARAMETERS else [[k] for k in own])
    ]


def _alike(parts: Sequence[Effect]) -> bool:
    """Tell whether parts of an effect are of one kind, so that their order alone names them."""
    return len(parts) > 1 and len({type(part) for part in parts}) == 1


def _log_weights(
    grids: Sequence[FloatArray], table: FloatArray
) -> tuple[list[FloatArray], FloatArray]:
    """Return points along each grid and ln of each cell's weight in a mixture, (k,) or (k, l).

    `table` (n, a) or (n, m, a): ln of the posterior at the values, which a spline joins.
    """
    points = [_between(grid) for grid in grids]
    dense = table
    for axis, (grid, fine) in enumerate(zip(grids, points, strict=True)):
        dense = CubicSpline(grid, dense, axis=axis)(fine)
    widths = reduce(np.multiply.outer, [np.gradient(fine) for fine in points])
    log_weight: FloatArray = np.logaddexp.reduce(dense, axis=-1) + np.log(widths)
    return points, log_weight


def _between(grid: FloatArray) -> FloatArray:
    """Return the values of a grid and points between them."""
    parts = [np.linspace(a, b, POINTS_PER_STEP, endpoint=False) for a, b in pairwise(grid)]
    return np.concatenate([*parts, grid[-1:]])


def _alternatives(
    hypotheses: SensorHypotheses, components: Sequence[Component]
) -> list[Alternative]:
    """Return the alternatives that may count, with ln of their priors."""
    hypotheses.allow_unnamed()
    state = hypotheses.conditioned(components)
    explained = hypotheses.explained(components)
    log_prior = priors.flaw_log_prior(float(np.sqrt(explained)))

    def gain(term: ColumnGroup) -> tuple[float, float]:
        return gain_of(state, FlexibleFunction(term, log_prior))

    variables = [r.term for r in hypotheses.regressors if r.depends_on != 'temperature']
    singles = sorted(((gain(term), term) for term in variables), key=lambda pair: -pair[0][0])
    whole = gain(hypotheses.discrepancy)
    flaws = [((*whole, hypotheses.discrepancy), 1)]
    flaws += [((*gained, term), len(singles)) for gained, term in singles[:LIKELIEST_VARIABLES]]
    beside: list[tuple[float, tuple[CoefficientPrior, ...]]] = [
        (float(np.log(1.0 - priors.FORM_APPROXIMATE_PROBABILITY)), ())
    ]
    share = float(np.log(priors.FORM_APPROXIMATE_PROBABILITY / 3.0))
    for (gained, size, term), ways in flaws:
        columns = term.columns
        width = np.full(len(columns), size / np.sqrt(state.power(columns)))
        flaw = CoefficientPrior(columns, shared=term.shared, deviation=width)
        best = float(state.evidences(
            np.array([columns]), np.array([size]), shared=term.shared, beside=True
        )[0][0, 0]) - state.log_evidence  # fmt: skip
        # All amplitudes count; the best one's evidence is in the equations themselves.
        beside.append((share - float(np.log(ways)) + gained - best, (flaw,)))
    found = [
        Alternative(own + further, (*nuisances, *flaw))
        for own, nuisances in hypotheses.nuisances
        for further, flaw in beside
    ]
    weight = _log_evidences(hypotheses, components, found) + [one.log_prior for one in found]
    order = np.argsort(-weight)[:MOST_ALTERNATIVES]
    kept = [found[k] for k in order if weight[k] > weight[order[0]] - NEGLIGIBLE_LOG_ODDS]
    exact = found[max(range(0, len(found), len(beside)), key=lambda k: weight[k])]
    each = exact.log_prior - beside[0][0] + share - float(np.log(len(priors.SECOND_PARTS)))
    return [*kept, *(Alternative(each, exact.priors, parts) for parts in priors.SECOND_PARTS)]


def _log_evidences(
    hypotheses: SensorHypotheses,
    components: Sequence[Component],
    alternatives: Sequence[Alternative],
) -> FloatArray:
    """Return (a,) ln evidence of components beside each alternative."""
    beside = [(*one.priors, *(c.prior for c in components)) for one in alternatives]
    every = {column for together in beside for prior in together for column in prior.columns}
    known = hypotheses.design.products_among(sorted(every))
    chi_square = hypotheses.design.chi_square
    found = [joint_evidence(*known, chi_square, hypotheses.rows, some)[0] for some in beside]
    return np.array(found)
