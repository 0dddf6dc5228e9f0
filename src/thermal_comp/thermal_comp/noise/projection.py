# SPDX-License-Identifier: Apache-2.0
"""Projections of a run that take a basis and further effects out, kept as long as the run is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from weakref import WeakKeyDictionary

import numpy as np
from imu_recording.recording import FloatArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import orthonormal, project_out
from thermal_comp.noise.process import Projection, Shaking, project_spectra
from thermal_comp.noise.saturated_model import joined_basis

LEAST_BLOCKS = 30
"""Blocks a run needs for a spectrum of its noise."""
FOLLOWED_SHARE = 0.01
"""Share of the rms of an effect's column outside a basis, up to which the basis follows it."""

Basis = Callable[[PreparedRun], FloatArray]
"""Function that returns an orthonormal basis (m, p) over the blocks of a run."""
FurtherColumns = Mapping[tuple[Sensor, Effect], FloatArray]
"""Columns (m, …) of effects beside a basis, by sensor and effect: some hold the sensor's input."""

Key = tuple[Basis, bytes, tuple[tuple[Sensor, Effect], ...]]
_PROJECTIONS: WeakKeyDictionary[PreparedRun, dict[Key, Projection]] = WeakKeyDictionary()
"""Projections of runs by basis, valid rows and further effects."""
_BASES: WeakKeyDictionary[PreparedRun, dict[Basis, FloatArray]] = WeakKeyDictionary()


def projection_of(
    run: PreparedRun,
    valid: NDArray[np.bool_],
    basis: Basis,
    further: FurtherColumns,
    shaking: Shaking | None,
    time_constants: FloatArray,
) -> Projection:
    """Return the projection that takes basis and further columns out of the valid rows.

    `shaking` is that of the valid rows; the time constants (k,) [s] are those of the noise.
    """
    kept = _PROJECTIONS.setdefault(run, {})
    weights = b'' if shaking is None else shaking.weights.tobytes()
    key = (basis, valid.tobytes() + weights + time_constants.tobytes(), tuple(further))
    if key not in kept:
        columns = basis_of_rows(run, valid, basis, further, shaking)
        slot = run.slot[valid] - run.slot[valid][0]
        kept[key] = project_spectra(slot, columns, time_constants, run.period, shaking)
    return kept[key]


def basis_of_rows(
    run: PreparedRun,
    valid: NDArray[np.bool_],
    basis: Basis,
    further: FurtherColumns,
    shaking: Shaking | None = None,
) -> FloatArray:
    """Return an orthonormal basis over the valid rows, weighted where `shaking` weighs them."""
    columns = _basis_over(run, basis)
    if further:
        columns = joined_basis([columns, *(c.reshape(len(run), -1) for c in further.values())])
    if shaking is not None:
        return orthonormal(shaking.weights[:, None] * columns[valid])
    return columns if valid.all() else orthonormal(columns[valid])


def not_followed(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect], basis: Basis
) -> tuple[Effect, ...]:
    """Return the effects that the basis cannot follow in some run."""
    return tuple(
        e
        for e in effects
        if any(_share_outside(r, sensor, e, basis) > FOLLOWED_SHARE for r in runs)
    )


def _share_outside(run: PreparedRun, sensor: Sensor, effect: Effect, basis: Basis) -> float:
    """Return the largest share of the rms of a column of the effect that is outside the basis."""
    columns = run.columns(effect, sensor).reshape(len(run), -1)
    columns = columns - columns.mean(axis=0)
    size = np.linalg.norm(columns, axis=0)
    moving = size > 1e-9 * size.max(initial=1e-300)
    outside = project_out(_basis_over(run, basis), columns)
    share = np.linalg.norm(outside[:, moving], axis=0) / size[moving]
    return float(share.max(initial=0.0))


def _basis_over(run: PreparedRun, basis: Basis) -> FloatArray:
    kept = _BASES.setdefault(run, {})
    if basis not in kept:
        kept[basis] = basis(run)
    return kept[basis]
