# SPDX-License-Identifier: Apache-2.0
"""What effects make of errors of the temperature: between bursts, and of the thermometer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence.effect_sets import Component, fitted_coefficients
from thermal_comp.diagnosis.evidence.temperature_course import temperature_history
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnGroup
from thermal_comp.linear.gaussian_evidence import CoefficientPrior

FittedEffect: TypeAlias = tuple[Effect, FloatArray]
"""One effect and its (p, 3) coefficients."""


@dataclass(frozen=True, eq=False)
class FeltErrors:
    """What the effects of a set, with their likeliest coefficients, make of a wrong temperature.

    Along one course on all axes.
    """

    design: CandidateDesign
    between_bursts: ColumnGroup
    """Of each run's errors between bursts."""
    thermometer: ColumnGroup
    """Of the thermometer's errors, through the slope over temperature and the set's derivatives of
    the temperature; it takes the place of that of the slope alone."""

    def __bool__(self) -> bool:
        return bool(self.between_bursts.columns or self.thermometer.columns)

    def beside(
        self, nuisances: Sequence[CoefficientPrior], deviations: FloatArray
    ) -> list[CoefficientPrior]:
        """Return nuisances with these errors; those of the thermometer have (p,) `deviations`."""
        first, *others = nuisances
        if self.thermometer.columns:
            deviations = deviations * self.design.size_of(self.thermometer)
            first = CoefficientPrior(self.thermometer.columns, True, deviations)
        if self.between_bursts.columns:
            size = self.design.size_of(self.between_bursts)
            others.append(CoefficientPrior(self.between_bursts.columns, True, size))
        return [first, *others]


def felt_errors(
    design: CandidateDesign,
    components: Sequence[Component],
    nuisances: Sequence[CoefficientPrior],
    by_slope: Mapping[str, FloatArray],
) -> FeltErrors:
    """Return what components make of errors of the temperature.

    `by_slope`: what the slope over temperature makes of those of the thermometer, by run.

    Effects have the coefficients that are likeliest beside the nuisances. Those that remember the
    temperature feel what it was between bursts. A derivative feels a thermometer that lags, most
    at the corners of the temperature and where a device is switched on in the cold.
    """
    none = ColumnGroup((), shared=True)
    errors = {run.name: run.errors_between_bursts for run in design.source.runs}
    in_bursts = any(some.size for some in errors.values())
    by_rate = any(c.form.effect.differentiates for c in components)
    if not components or not (in_bursts or by_rate):
        return FeltErrors(design, none, none)
    fitted = _fitted(design, components, nuisances)
    rates = [(effect, k) for effect, k in fitted if effect.differentiates]

    def between(run: PreparedRun) -> FloatArray:
        return _responses(fitted, errors[run.name], run, design.sensor)

    def of_thermometer(run: PreparedRun) -> FloatArray:
        history = temperature_history(run)  # what comes first among the errors
        answer = by_slope[run.name].copy()
        answer[:, :, : history.shape[1]] += _responses(rates, history, run, design.sensor)
        return answer

    def term(function: Callable[[PreparedRun], FloatArray], *, per_run: bool) -> ColumnGroup:
        return design.generic_terms([(function, per_run)], runs=design.source.smoothed)[0]

    return FeltErrors(
        design,
        term(between, per_run=True) if in_bursts else none,
        term(of_thermometer, per_run=False) if by_rate else none,
    )


def _fitted(
    design: CandidateDesign,
    components: Sequence[Component],
    nuisances: Sequence[CoefficientPrior],
) -> list[FittedEffect]:
    """Return the effects whose axes each follow one course, with their coefficients."""
    fitted: list[FittedEffect] = []
    each = fitted_coefficients(design, components, nuisances)
    for component, found in zip(components, each, strict=True):
        form, place = component.form, 0
        for effect, term in zip(form.effect.parts(), form.terms, strict=True):
            own = slice(place, place := place + len(term.columns))
            if form.run is None and not term.shared and not effect.per_run:
                size = design.size_of(term)[:, None]
                known = found[:, own].T
                fitted.append(
                    (effect, np.where(size > 0.0, known / np.maximum(size, 1e-300), 0.0))
                )
    return fitted


def _responses(
    fitted: Sequence[FittedEffect], errors: FloatArray, run: PreparedRun, sensor: Sensor
) -> FloatArray:
    """(m, 3, e) change of what effects do to the block means, by errors (n, e) of temperature."""
    answer = np.zeros((len(run), 3, errors.shape[1]))
    for effect, coefficients in fitted:
        means = partial(_block_means, effect, run, run.conditions.of(sensor))
        before = means(0.0)
        if before.ndim > 2:
            continue  # it differs between axes: it follows force, field or rate
        for place, error in enumerate(errors.T):
            answer[:, :, place] += (means(error) - before) @ coefficients
    return answer


def _block_means(
    effect: Effect, run: PreparedRun, conditions: Conditions, more: FloatArray | float
) -> FloatArray:
    """Return the columns of an effect in a run whose temperature is higher by so much."""
    changed = replace(conditions, temperature=conditions.temperature + more)
    return run.block_mean(effect.columns_in_hindsight(changed))
