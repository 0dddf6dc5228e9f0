# SPDX-License-Identifier: Apache-2.0
"""The noise beside a model, its slow part as it was in these runs.

A saturated model follows cycles and hours as well, so that a bias that creeps is not taken for
noise; what slow noise did in these very runs hides under it and is only extrapolated, which is
wrong by some 10 % of its standard deviation. The error of a part that is held out is mostly slow
noise. Where a model leaves no more in cycles and hours than noise may, that is what is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from weakref import WeakKeyDictionary

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import LEAST_BLOCKS, expected_square, fit_noise_to_spectra
from thermal_comp.noise.process import (
    OU_TIME_CONSTANTS,
    Projection,
    ResidualSpectrum,
    project_spectra,
)
from thermal_comp.noise.saturated_model import joined_basis, repeatable_basis

MOST_SPREAD_RATIO = 1.15
"""Rms about a run's mean, in that of the extrapolated noise, beyond which what is left in cycles
and hours is no noise: an effect that was not named. Chance reaches 1.11 in a hundred campaigns."""
FOLLOWED = 0.01
"""Share of a column's rms outside the basis up to which the basis follows it."""

Key = tuple[bytes, Sensor | None, tuple[Effect, ...]]
_PROJECTIONS: WeakKeyDictionary[PreparedRun, dict[Key, Projection]] = WeakKeyDictionary()
"""By valid rows, and by sensor and effects where the basis alone does not follow them."""
_BASES: WeakKeyDictionary[PreparedRun, FloatArray] = WeakKeyDictionary()


def noise_of_model(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    effects: Sequence[Effect],
    extrapolated: NoiseModel,
) -> NoiseModel:
    """Return the noise that a model of these effects leaves in the runs.

    Everything repeatable and the columns of `effects` are taken out, cycles and hours are not.
    `extrapolated`, the noise behind a saturated model, is returned where more than noise is left.
    """
    spectra = [_spectrum(run, sensor, tuple(effects)) for run in runs]
    if any(spectrum is None for spectrum in spectra):
        return extrapolated
    found = fit_noise_to_spectra([s for s in spectra if s is not None])
    more = _spread(runs, found) / np.maximum(_spread(runs, extrapolated), 1e-300)
    return found if more <= MOST_SPREAD_RATIO**2 else extrapolated


def _spread(runs: Sequence[PreparedRun], noise: NoiseModel) -> float:
    """Return the expected mean square about the mean of each run, summed over the axes."""
    total = 0.0
    for run in runs:
        level = np.full((len(run), 1), 1.0 / np.sqrt(len(run)))
        variance = noise.variance_of_means(run.period)
        for axis in range(3):
            share = expected_square(noise, run, axis, level) / len(run)
            total += float(variance[axis]) - share
    return total


def _spectrum(
    run: PreparedRun, sensor: Sensor, effects: tuple[Effect, ...]
) -> ResidualSpectrum | None:
    values = run.measured[sensor]
    valid = np.isfinite(values).all(axis=1)
    if valid.sum() < LEAST_BLOCKS:
        return None
    if run not in _BASES:
        _BASES[run] = repeatable_basis(run)
    basis = _BASES[run]
    further = {e: c for e in effects if not _follows(basis, c := _columns(run, sensor, e))}
    kept = _PROJECTIONS.setdefault(run, {})
    key: Key = (valid.tobytes(), sensor if further else None, tuple(further))
    if key not in kept:
        if further:
            basis = joined_basis([basis, *further.values()])
        if not valid.all():
            basis, _ = np.linalg.qr(basis[valid])
        slot = run.slot[valid] - run.slot[valid][0]
        kept[key] = project_spectra(slot, basis, OU_TIME_CONSTANTS, run.period)
    return kept[key].spectrum_of(values[valid])


def _columns(run: PreparedRun, sensor: Sensor, effect: Effect) -> FloatArray:
    """Return the effect's columns (m, q), those of all axes beside each other."""
    return run.columns(effect, sensor).reshape(len(run), -1)


def _follows(basis: FloatArray, columns: FloatArray) -> bool:
    centred = columns - columns.mean(axis=0)
    size = np.linalg.norm(centred, axis=0)
    left = np.linalg.norm(centred - basis @ (basis.T @ centred), axis=0)
    return bool((left <= FOLLOWED * size + 1e-9 * size.max(initial=1e-300)).all())
