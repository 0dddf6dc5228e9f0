# SPDX-License-Identifier: Apache-2.0
"""Normal equations of millions of samples, piece by piece: columns are built, used and dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.conditions import Conditions
from thermal_comp.effects.effect import Effect, State
from thermal_comp.fit_solution import NormalEquations
from thermal_comp.model import ModelError

PIECE = 16_384
"""Samples taken at a time; columns of a piece stay in the processor's cache."""


@dataclass(frozen=True, eq=False)
class Gram:
    """Sums of products of 1, p columns and q measured values over n samples of one run."""

    products: FloatArray
    """(1 + p + q, 1 + p + q)."""
    measured: int
    """q."""

    def equations(self) -> NormalEquations:
        """Return the normal equations with the run's level taken out."""
        n = self.products[0, 0]
        sums = self.products[0, 1:]
        centred = self.products[1:, 1:] - np.outer(sums, sums) / n
        p = len(centred) - self.measured
        return NormalEquations(
            gram=centred[:p, :p],
            moment=centred[:p, p:],
            energy=np.diag(centred)[p:],
            rows=int(n) - 1,
        )


def gram(
    effects: Sequence[Effect], conditions: Conditions, measured: Sequence[FloatArray]
) -> Gram:
    """Return the products of the effects' columns (n, p) and the measured arrays (n, 3).

    All sensors share the columns, so the effects must not look at the sensor, and their
    coefficients are per axis. Rows in which anything is not finite do not count. History effects
    carry their state from piece to piece.
    """
    q = sum(values.shape[1] for values in measured)
    total = np.zeros((0, 0))
    states: list[State | None] = [None] * len(effects)
    # A level the run's own takes up anyway: without it small residuals drown in large sums.
    medians = [np.nanmedian(values[:PIECE], axis=0) for values in measured]
    shift = np.nan_to_num(np.concatenate(medians))[:, None]
    for start in range(0, len(conditions), PIECE):
        rows = slice(start, start + PIECE)
        part = conditions.rows(rows)
        stacked = [np.ones((len(part), 1))]
        for k, effect in enumerate(effects):
            columns, states[k] = effect.columns(part, states[k])
            if columns.ndim == 3:
                raise ModelError(
                    f'{effect.name}: its axes share coefficients; fit it to block means'
                )
            stacked.append(columns)
        stacked += [values[rows] for values in measured]
        # Columns lie contiguously, as the product reads them.
        block = np.empty((sum(c.shape[1] for c in stacked), len(part)))
        np.concatenate([c.T for c in stacked], out=block)
        block[-q:] -= shift
        products = block @ block.T
        if not np.isfinite(products[0]).all():
            block = block[:, np.isfinite(block).all(axis=0)]
            products = block @ block.T
        total = products if not total.size else total + products
    return Gram(total, q)
