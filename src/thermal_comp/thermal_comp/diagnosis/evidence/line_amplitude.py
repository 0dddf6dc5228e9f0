# SPDX-License-Identifier: Apache-2.0
"""Lines that come and go, and lines that wander.

A machine that is switched keeps the phase of the mains: its line has a course of the amplitude
alone. That of a machine whose speed wanders leaves its phase as well; so does one that moves with
the temperature, where that is not known well enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.evidence.effect_sets import Component, fitted_coefficients
from thermal_comp.diagnosis.evidence.generic_regressors import BAND_PIECES, spline
from thermal_comp.diagnosis.evidence.hypotheses import SensorHypotheses
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.candidate_design import ColumnGroup


@dataclass(frozen=True)
class LineCourses:
    """What a line of a set lacks where it is not steady, on all axes alike."""

    own: ColumnGroup
    """By its own cause: a course of the amplitude, and of a phase that is not well known."""
    of_others: ColumnGroup | None
    """By another cause: courses of amplitude and phase; None where none makes such a line."""


def courses_of_lines(
    hypotheses: SensorHypotheses, components: Sequence[Component]
) -> list[LineCourses]:
    """Return the courses that each line of a set may have, about what it is likeliest to be."""
    design = hypotheses.design
    if not any(c.form.effect.line_frequency for c in components):
        return []
    courses = []
    nuisances = hypotheses.likeliest_nuisances(components)
    each = fitted_coefficients(design, components, nuisances)
    for component, found in zip(components, each, strict=True):
        effect = component.form.effect
        if effect.line_frequency:
            size = np.concatenate([design.size_of(term) for term in component.form.terms])
            unit = found / np.maximum(size, 1e-300)
            cosine, sine = np.moveaxis(unit.reshape(3, -1, 2), 2, 0)
            phases = [np.stack(pair, axis=2) for pair in ((cosine, sine), (-sine, cosine))]
            functions = [(partial(_course, hypotheses, effect, one), True) for one in phases]
            own, turned = (replace(t, shared=True) for t in design.generic_terms(functions))
            both = ColumnGroup((*own.columns, *turned.columns), shared=True)
            design.equations(both.columns)  # the products of one with the other, too
            any_cause = effect.of_any_cause
            courses.append(LineCourses(own, both) if any_cause else LineCourses(both, None))
    return courses


def _course(
    hypotheses: SensorHypotheses, effect: Effect, coefficients: FloatArray, run: PreparedRun
) -> FloatArray:
    """(m, 3, p) splines over time of a line whose runs have coefficients (3, runs, 2)."""
    runs = hypotheses.design.source.runs
    longest = max(float(one.time[-1]) for one in runs)
    waves = effect.columns(run.conditions.of(hypotheses.design.sensor))[0]
    line = waves @ coefficients[:, runs.index(run)].T
    slow = spline(run.conditions.time, 0.0, longest, BAND_PIECES)
    return run.block_mean(line[:, :, None] * slow[:, None, :])
