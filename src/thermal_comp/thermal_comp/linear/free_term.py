# SPDX-License-Identifier: Apache-2.0
"""Least squares of a design in which the form of one term is free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.design import LEAST_DEVIATION, Design, Term
from thermal_comp.linear.normal_equations import Factor, factor


@dataclass(frozen=True, eq=False)
class FreeTerm:
    """A term whose form is searched beside columns that stand: those are eliminated once.

    With FᵀF = L Lᵀ of the columns F that stand, columns X of the term leave
    χ² = χ²_F − |S^(−½) (Xᵀy − Aᵀb)|², where A = L⁻¹FᵀX, b = L⁻¹Fᵀy and S = XᵀX − AᵀA
    (variable projection: Golub and Pereyra, SIAM Journal on Numerical Analysis 10, 1973).
    """

    design: Design
    term: Term
    pieces: Mapping[tuple[int, Sensor, int], tuple[IntArray, FloatArray, FloatArray]]
    """Run, sensor and axis the term acts on → unknowns, whitened F and y."""
    size: int
    """Unknowns of the columns that stand."""
    known: Factor
    half: FloatArray
    """b."""
    chi_square: float
    """Of the columns that stand alone."""

    @classmethod
    def of(cls, design: Design, term: Term) -> FreeTerm:
        """Return the term of a design, with everything else eliminated."""
        others = design.with_effects(
            {
                sensor: tuple(e for e in listed if sensor not in term.sensors or e != term.effect)
                for sensor, listed in design.effects.items()
            }
        )
        equations = others.equations()
        known = factor(equations.gram)
        half = known.half(equations.moment)[:, 0]
        left = float(equations.energy[0] - half @ half)
        pieces = {key: others.piece(*key) for key in others.pieces() if key[1] in term.sensors}
        return cls(design, replace(term, start=0), pieces, others.size, known, half, left)

    def least_squares(self, effect: Effect) -> float:
        """Return the least whitened sum of squares with the term in the form of `effect`."""
        design, term = self.design, self.term
        size = int(np.prod(term.shape))
        gram, moment = np.zeros((size, size)), np.zeros(size)
        across = np.zeros((self.size, size))
        every: dict[tuple[int, Sensor], FloatArray] = {}
        for (run, sensor, axis), (index, standing, right) in self.pieces.items():
            if (run, sensor) not in every:
                columns = design.runs[run].columns(effect, sensor)
                every[run, sensor] = columns[design.valid(run, sensor)]
            columns = every[run, sensor]
            part = columns[:, axis] if columns.ndim == 3 else columns
            white = design.whitened(part, run, sensor, axis)
            place = term.indices(run, axis, white.shape[1])
            gram[np.ix_(place, place)] += white.T @ white
            moment[place] += white.T @ right[:, 0]
            across[np.ix_(index, place)] += standing.T @ white
        deviations = effect.coefficient_deviations()
        if deviations is not None:
            gram.flat[:: size + 1] += 1.0 / np.maximum(deviations.ravel(), LEAST_DEVIATION) ** 2
        reduced = self.known.half(across)
        new = factor(gram - reduced.T @ reduced, np.diag(gram))
        new_half = new.half((moment - reduced.T @ self.half)[:, None])
        return max(self.chi_square - float((new_half**2).sum()), 0.0)
