# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of shape parameters where the equation of an effect is only nearly right.

A fit knows a time constant as well as if the lag were exactly of first order and the thermometer
had no lag of its own. Here the equation may lack something as large as a share of what it
explains: a smooth function of all that was logged, or of one variable (the discrepancy of Kennedy
and O'Hagan, Bayesian Calibration of Computer Models, 2001), and the thermometer may err as in a
diagnosis. Each alternative has a posterior of its own over the shape parameters u, by Laplace

    ln p(u) ≈ ln p(û) + gᵀ(u − û) − ½ (u − û)ᵀ H (u − û),

about the fitted û. The uncertainty is the rms distance from û under their mixture.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.blocks import in_search_blocks
from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.spectral_lines import SpectralLine
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import form_of
from thermal_comp.diagnosis.evidence.effect_sets import Component
from thermal_comp.diagnosis.evidence.flaws import gain_of
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.shape_search import ShapeScale, shape_scales, shape_values, with_shape
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.linear.gaussian_evidence import CoefficientPrior, joint_evidence, log_sum
from thermal_comp.model.values import SensorModel, ThermalModel

LIKELIEST_VARIABLES = 3
"""Single variables whose functions are tried as what an equation lacks."""
MOST_ALTERNATIVES = 8
"""Alternatives that are expanded in the shape parameters …"""
NEGLIGIBLE_LOG_ODDS = 7.0
"""… and ln of the odds against the likeliest from which one does not count."""
LEAST_CURVATURE = 0.01
"""Least curvature at steps of one standard deviation of the fit: ten of them are the most."""
LEAST_STEP, LARGEST_STEP = 1e-6, 0.1
"""Step of the finite differences, as a share of the range that is searched."""


@dataclass(frozen=True, eq=False)
class ShapeCoordinate:
    """One value of a shape parameter of one component, on its search scale."""

    component: int
    scale: ShapeScale
    value: float
    step: float
    """About one standard deviation of the fit."""

    def moved(self, effect: Effect, by: float) -> Effect:
        """Return the effect with this value `by` steps further."""
        value = np.array([self.value + by * self.step])
        return with_shape(effect, [self.scale], value)

    def std(self, deviation: float) -> float:
        """Return a deviation on the search scale in the parameter's own unit."""
        return deviation * self.scale.back(self.value) if self.scale.logarithmic else deviation


@dataclass(frozen=True, eq=False)
class Alternative:
    """What may be beside the effects: the thermometer's errors, slow noise, a flaw or none."""

    log_prior: float
    priors: tuple[CoefficientPrior, ...]


def with_model_form(model: ThermalModel, runs: Sequence[PreparedRun]) -> ThermalModel:
    """Return the model, standard deviations of its shape parameters with those of their form.

    Steps and spectral lines keep theirs: what limits them is a row, or a period over the run.
    """
    known = {s: model.sensors[s] for s in SENSORS if s in model.sensors}
    shaped = {s: part for s, part in known.items() if any(map(_form_limits, part.effects))}
    if not shaped:
        return model
    lines = [
        SpectralLine(effect.line_frequency, 0.0)
        for part in shaped.values()
        for effect in part.effects
        if effect.line_frequency is not None
    ]
    source = ColumnSource(in_search_blocks(runs, lines))
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
    hypotheses = SensorHypotheses(design, {})
    components = [
        Component(form_of(design, effect, None), float(priors.AMPLITUDES[0]), 1)
        for effect in shaped
    ]
    for place in range(len(components)):
        components, _ = hypotheses.scaled(components, place)
    coordinates = _coordinates(source.runs, components, part)
    deviations = shape_deviations(hypotheses, components, coordinates)
    total = dict(part.shape_std)
    form: dict[str, tuple[float, ...]] = {}
    for one, deviation in zip(coordinates, deviations, strict=True):
        name = f'{components[one.component].name}.{one.scale.name}'
        fitted = part.shape_std[name][one.scale.place or 0]
        further = np.sqrt(max(one.std(float(deviation)) ** 2 - fitted**2, 0.0))
        form[name] = (*form.get(name, ()), float(further))
    for name, further in form.items():
        total[name] = tuple(np.hypot(part.shape_std[name], further).tolist())
    return replace(part, shape_std=total, shape_form_std=form)


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
            step = float(np.clip(step, LEAST_STEP * span, LARGEST_STEP * span))
            found.append(ShapeCoordinate(number, scale, float(value), step))
    return found


def shape_deviations(
    hypotheses: SensorHypotheses,
    components: Sequence[Component],
    coordinates: Sequence[ShapeCoordinate],
) -> FloatArray:
    """Return (p,) rms deviations of shape parameters from their values, on the search scale.

    At most that of any value in the range that is searched.
    """
    alternatives = _alternatives(hypotheses, components)

    def at(steps: FloatArray) -> FloatArray:
        effects = [component.form.effect for component in components]
        for one, by in zip(coordinates, steps, strict=True):
            if by:
                effects[one.component] = one.moved(effects[one.component], float(by))
        moved = [
            replace(c, form=form_of(hypotheses.design, effect, None))
            for c, effect in zip(components, effects, strict=True)
        ]
        return _log_evidences(hypotheses, moved, alternatives)

    with hypotheses.design.trials():
        here, gradient, curvature = _expansion(at, len(coordinates))
    prior = np.array([one.log_prior for one in alternatives])
    squares = _mixture_squares(prior + here, gradient, curvature)
    found = np.sqrt(squares) * np.array([one.step for one in coordinates])
    widest = [float(np.ptp(one.scale.grid())) / 12.0**0.5 for one in coordinates]
    deviations: FloatArray = np.minimum(found, widest)
    return deviations


def _alternatives(
    hypotheses: SensorHypotheses, components: Sequence[Component]
) -> list[Alternative]:
    """Return the alternatives that may count, with ln of their priors."""
    hypotheses.allow_unnamed()
    state = hypotheses.conditioned(components)
    explained = hypotheses.log_evidence(components)[1] - hypotheses.log_evidence(())[1]
    amplitudes = priors.flaw_log_prior(float(np.sqrt(max(explained, 0.0))))
    variables = [r.term for r in hypotheses.regressors if r.depends_on != 'temperature']
    singles = sorted(
        ((gain_of(state, term, amplitudes, beside=True), term) for term in variables),
        key=lambda pair: -pair[0][0],
    )
    whole = gain_of(state, hypotheses.discrepancy, amplitudes, beside=True)
    flaws = [((*whole, hypotheses.discrepancy), 1)]
    flaws += [((*gain, term), len(singles)) for gain, term in singles[:LIKELIEST_VARIABLES]]
    beside: list[tuple[float, tuple[CoefficientPrior, ...]]] = [
        (float(np.log(1.0 - priors.FORM_APPROXIMATE)), ())
    ]
    share = float(np.log(priors.FORM_APPROXIMATE / 2.0))
    for (gain, size, term), ways in flaws:
        columns = term.columns
        width = np.full(len(columns), size / np.sqrt(state.power(columns)))
        flaw = CoefficientPrior(columns, shared=term.shared, deviation=width)
        best = float(state.evidences(
            np.array([columns]), np.array([size]), shared=term.shared, beside=True
        )[0][0, 0]) - state.log_evidence  # fmt: skip
        # All amplitudes count; the best one's evidence is in the equations themselves.
        beside.append((share - float(np.log(ways)) + gain - best, (flaw,)))
    found = [
        Alternative(own + further, (*nuisances, *flaw))
        for own, nuisances in hypotheses.nuisances
        for further, flaw in beside
    ]
    weight = _log_evidences(hypotheses, components, found) + [one.log_prior for one in found]
    order = np.argsort(-weight)[:MOST_ALTERNATIVES]
    return [found[k] for k in order if weight[k] > weight[order[0]] - NEGLIGIBLE_LOG_ODDS]


def _log_evidences(
    hypotheses: SensorHypotheses,
    components: Sequence[Component],
    alternatives: Sequence[Alternative],
) -> FloatArray:
    """Return (a,) ln evidence of components beside each alternative."""
    design = hypotheses.design
    every = dict.fromkeys(c for one in alternatives for prior in one.priors for c in prior.columns)
    every |= dict.fromkeys(c for component in components for c in component.columns)
    normal, right = design.equations(list(every))
    place = {column: number for number, column in enumerate(every)}
    found = []
    for one in alternatives:
        together = [*one.priors, *(component.prior for component in components)]
        index = [place[c] for prior in together for c in prior.columns]
        own = normal[:, np.array(index)[:, None], index], right[:, index]
        found.append(joint_evidence(*own, design.chi_square, hypotheses.rows, together)[0])
    return np.array(found)


def _expansion(
    at: Callable[[FloatArray], FloatArray], count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return (a,) values, (a, p) gradients and (a, p, p) curvatures −∂² of functions at zero."""
    units = np.eye(count)
    here = at(np.zeros(count))
    up, down = (np.array([at(sign * unit) for unit in units]) for sign in (1.0, -1.0))
    gradient = 0.5 * (up - down).T
    curvature = np.zeros((len(here), count, count))
    for i in range(count):
        curvature[:, i, i] = 2.0 * here - up[i] - down[i]
        for k in range(i):
            both = at(units[i] + units[k]) + at(-units[i] - units[k]) - 2.0 * here
            cross = 0.5 * (both - (up[i] + down[i] - 2.0 * here) - (up[k] + down[k] - 2.0 * here))
            curvature[:, i, k] = curvature[:, k, i] = -cross
    return here, gradient, curvature


def _mixture_squares(
    weight: FloatArray, gradient: FloatArray, curvature: FloatArray
) -> FloatArray:
    """Return (p,) mean squares of a mixture of Gaussians about zero.

    Each has ln of its weight at zero (a,), a gradient (a, p) and a curvature (a, p, p) there.
    """
    values, vectors = np.linalg.eigh(curvature)
    values = np.maximum(values, LEAST_CURVATURE)
    inverse = np.einsum('aij,aj,akj->aik', vectors, 1.0 / values, vectors)
    mean = np.einsum('aij,aj->ai', inverse, gradient)
    weight = weight + 0.5 * (mean * gradient).sum(axis=1) - 0.5 * np.log(values).sum(axis=1)
    share = np.exp(weight - log_sum(weight))
    squares: FloatArray = share @ (np.diagonal(inverse, axis1=1, axis2=2) + mean**2)
    return squares
