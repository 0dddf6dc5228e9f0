# SPDX-License-Identifier: Apache-2.0
"""What the temperature may have done between bursts, seen by effects that remember it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence.effect_sets import Component
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import CandidateDesign
from thermal_comp.linear.gaussian_evidence import CoefficientPrior, likeliest_coefficients

FittedEffect: TypeAlias = tuple[Effect, FloatArray]
"""One effect and its (p, 3) coefficients."""


def felt_errors(
    design: CandidateDesign,
    components: Sequence[Component],
    nuisances: Sequence[CoefficientPrior],
) -> list[CoefficientPrior]:
    """Return what components make of errors of each run's temperature between bursts.

    It is that of effects with the coefficients that are likeliest beside the nuisances, along one
    course on all axes. [] where there are no errors, or nobody feels them.
    """
    errors = {run.name: run.errors_between_bursts for run in design.source.runs}
    if not components or not any(some.size for some in errors.values()):
        return []
    fitted = _fitted(design, components, nuisances)

    def responses(run: PreparedRun) -> FloatArray:
        return _responses(fitted, errors[run.name], run, design.sensor)

    term = design.generic_terms([(responses, True)], runs=design.source.smoothed)[0]
    return [CoefficientPrior(term.columns, shared=True, deviation=design.size_of(term))]


def _fitted(
    design: CandidateDesign,
    components: Sequence[Component],
    nuisances: Sequence[CoefficientPrior],
) -> list[FittedEffect]:
    """Return the effects whose axes each follow one course, with their coefficients."""
    allowed = [*(c.prior for c in components), *nuisances]
    normal, right = design.products_among([c for prior in allowed for c in prior.columns])
    found = likeliest_coefficients(normal, right, allowed)
    fitted: list[FittedEffect] = []
    for component in components:
        form = component.form
        for effect, term in zip(form.effect.parts(), form.terms, strict=True):
            columns = list(term.columns)
            if form.run is None and not term.shared and not effect.per_run:
                size = design.size_of(term)[:, None]
                known = found[:, : len(columns)].T
                fitted.append(
                    (effect, np.where(size > 0.0, known / np.maximum(size, 1e-300), 0.0))
                )
            found = found[:, len(columns) :]
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
