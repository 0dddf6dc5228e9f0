# SPDX-License-Identifier: Apache-2.0
"""How wide the prior of the empirical term has to be: by the marginal likelihood, axis by axis."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.empirical_term import GROUPS, Empirical
from thermal_comp.linear.design import Design
from thermal_comp.linear.normal_equations import NormalEquations, pseudo_solve
from thermal_comp.model.values import NoiseModel

LEVELS = (1.0, 6.7, 45.0, 300.0)
"""Rms a group of columns may have, in standard deviations of a whitened row."""
PRESENT = 0.3
"""Probability that an axis needs a group at all."""


def empirical_form(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    beside: Sequence[Effect],
    noise: NoiseModel,
) -> Empirical | None:
    """Return the empirical term with the most probable prior; None where no axis needs it.

    Each group of columns of each axis is absent or has one of LEVELS; levels of the runs and the
    effects `beside` are projected out, the noise level is integrated: −n/2 · ln of the residual.
    """
    low = min(float(run.temperature.min()) for run in runs)
    high = max(float(run.temperature.max()) for run in runs)
    open_form = Empirical(0.5 * (low + high), max(0.5 * (high - low), 1.0), (1e6,) * 12)
    design = Design(runs, {sensor: (*beside, open_form)}, {sensor: noise})
    (term,) = (t for t in design.terms if t.effect == open_form)
    equations = design.equations()
    widths = np.zeros((4, 3))
    for axis in range(3):
        own = term.indices(0, axis, len(GROUPS))
        reduced = _without(equations, own, range(term.unknowns.start))
        rows = sum(int(design.valid(r, sensor).sum()) for r in range(len(runs)))
        energy = _energy(design, sensor, axis, equations, range(term.unknowns.start))
        widths[:, axis] = _likeliest_widths(*reduced, energy, rows)
    if not widths.any():
        return None
    return Empirical(open_form.middle, open_form.half_range, tuple(widths.ravel().tolist()))


def _without(
    equations: NormalEquations, own: IntArray, known: range
) -> tuple[FloatArray, FloatArray]:
    """Return normal matrix and right-hand side of some unknowns, others taken out."""
    gram, moment, before = equations.gram, equations.moment[:, 0], list(known)
    cross = gram[before][:, own]
    answer, _ = pseudo_solve(gram[before][:, before], np.column_stack([moment[before], cross]))
    return (
        gram[own][:, own] - cross.T @ answer[:, 1:],
        moment[own] - cross.T @ answer[:, 0],
    )


def _energy(
    design: Design, sensor: Sensor, axis: int, equations: NormalEquations, known: range
) -> float:
    """Return the whitened sum of squares of one axis that the other effects leave."""
    answer, _ = pseudo_solve(
        equations.gram[: known.stop, : known.stop], equations.moment[: known.stop]
    )
    estimate = np.zeros(design.size)
    estimate[: known.stop] = answer[:, 0]
    total = 0.0
    for run in range(len(design.runs)):
        valid = design.valid(run, sensor)
        if valid.any():
            level = estimate[design.level_index(run, sensor, axis)]
            left = design.runs[run].measured[sensor][:, axis] - level
            left = (left - design.predicted(estimate, run, sensor)[:, axis])[valid]
            total += float((design.whitened(left[:, None], run, sensor, axis) ** 2).sum())
    return total


def _likeliest_widths(
    gram: FloatArray, moment: FloatArray, energy: float, rows: int
) -> FloatArray:
    """Return (4,) prior standard deviations of the groups' coefficients, zero where absent."""
    powers = [float(np.diag(gram)[g == GROUPS].sum()) for g in range(4)]
    unit = np.sqrt(rows / np.maximum(powers, 1e-300))
    best, likeliest = -np.inf, np.zeros(4)
    for levels in product((0.0, *LEVELS), repeat=4):
        width = np.array(levels) * unit
        scale = width[GROUPS]
        on = scale > 0.0
        value = sum(
            np.log(PRESENT / len(LEVELS)) if level else np.log(1.0 - PRESENT) for level in levels
        )
        left = energy
        if on.any():
            s = scale[on]
            root = np.linalg.cholesky(
                np.eye(int(on.sum())) + s[:, None] * gram[np.ix_(on, on)] * s
            )
            half = np.linalg.solve(root, s * moment[on])
            left -= float(half @ half)
            value -= float(np.log(np.diag(root)).sum())
        value -= 0.5 * rows * float(np.log(max(left, 1e-300)))
        if value > best:
            best, likeliest = float(value), width
    return likeliest
