# SPDX-License-Identifier: Apache-2.0
"""How small an effect of each kind may be and still be found in these recordings."""

from __future__ import annotations

import numpy as np

from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.candidates import Family, Form, alternatives
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.linear.columns import per_axis
from thermal_comp.linear.gaussian_evidence import ConditionedDesign

LEAST_EXCITED_SHARE = 1e-3
"""Share of a column beside base model and nuisances from which these runs excite it."""
FIXED_POINT_ROUNDS = 30
"""Rounds of the fixed point for the Δχ² that is needed; it contracts by 2 and more in each."""


def smallest_found(hypotheses: SensorHypotheses, needed: float) -> dict[str, float]:
    """Return by effect the rms of its error, over runs and axes [SI unit], that is found.

    `needed` is 2 ln of the Bayes factor from which it is said that something is missing. An
    effect of p coefficients that explains g = Δχ² beside base model and nuisances has, at the
    amplitude that fits best, about

        2 ln K = g − p ln(1 + g / p) − 2 ln(alternatives · amplitudes)

    (Laplace's approximation of its evidence; a form's prior is one over its alternatives). The
    answer is the median over its forms; one whose column these runs do not excite beside the base
    model is left out.
    """
    state = hypotheses.conditioned(())
    found = {}
    for family in hypotheses.families:
        each = [_rms(hypotheses, state, family, form, needed) for form in family.forms]
        known = [rms for rms in each if np.isfinite(rms)]
        if known:
            found[family.name] = float(np.median(known))
    return found


def _rms(
    hypotheses: SensorHypotheses,
    state: ConditionedDesign,
    family: Family,
    form: Form,
    needed: float,
) -> float:
    """Return the rms of a form's first column where its coefficients explain enough."""
    term = form.terms[0]
    design = hypotheses.design
    # Of an effect of several terms, as a play with several widths, the first stands for all.
    column = int(term.columns[0])
    left = state.power([column])
    size = float(design.size_of(term)[0]) * float(np.sqrt(left))
    if left < LEAST_EXCITED_SHARE or size <= 0.0:
        return np.inf
    coefficients = sum(len(t.columns) for t in form.terms) * (1 if term.shared else 3)
    count = alternatives(design, family, form) * len(priors.AMPLITUDES)
    enough = needed + 2.0 * float(np.log(count))
    explained = float(np.sqrt(_needed_delta_chi2(enough, coefficients)))
    return explained / size * _size_of(hypotheses, form)


def _needed_delta_chi2(needed: float, coefficients: int) -> float:
    """Return g with g − p ln(1 + g / p) = needed."""
    delta_chi2 = needed
    for _ in range(FIXED_POINT_ROUNDS):
        delta_chi2 = needed + coefficients * float(np.log1p(delta_chi2 / coefficients))
    return delta_chi2


def _size_of(hypotheses: SensorHypotheses, form: Form) -> float:
    """Return the rms over runs and axes that one unit of the first coefficient makes."""
    design = hypotheses.design
    first = form.effect.parts()[0]
    runs = design.source.columns(first, design.sensor)
    only = form.run if form.run is not None else (0 if first.per_run else None)
    chosen = range(len(runs)) if only is None else [only]
    total = 0.0
    for number in chosen:
        columns = runs[number][design.valid[number]]
        alike = 3 if columns.ndim == 2 else 1  # axes that have the same one
        column = columns[:, 0] if alike == 3 else per_axis(columns)[0][..., 0]
        total += alike * float(((column - column.mean(axis=0)) ** 2).sum())
    rows = sum(int(valid.sum()) for valid in design.valid)
    return float(np.sqrt(total / (3.0 * rows)))
