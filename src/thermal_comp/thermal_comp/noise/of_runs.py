# SPDX-License-Identifier: Apache-2.0
"""The noise a fit weighs with: fitted where runs are long enough, white where they are not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import project_out
from thermal_comp.model.values import ModelError, NoiseModel
from thermal_comp.noise.estimation import effects_beyond, fit_noise
from thermal_comp.noise.projection import LEAST_BLOCKS, projection_of
from thermal_comp.noise.saturated_model import saturated_basis

CORRELATED_EVIDENCE = 10.0
"""2 ln of the Bayes factor from which noise is correlated between axes."""
FINEST_RESOLUTION = 1e-12
"""Least noise of a mean, as a share of the largest value: no measurement is better resolved."""


def noise_of_runs(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect] = ()
) -> tuple[NoiseModel, str]:
    """Return the noise beside `effects` and, where it is only a guess, a sentence saying so."""
    fitted = fit_noise(runs, sensor, effects)
    if _is_positive(fitted, runs):
        return fitted, ''
    white = np.sqrt(runs[0].period) * _scatter(runs, sensor)
    guess = NoiseModel(white, fitted.time_constants, np.zeros((len(fitted.time_constants), 3)))
    return guess, (
        f'{sensor}: the runs are too short to tell the colour of its noise; it is taken as white, '
        'from what a line in temperature leaves'
    )


def determined_noise(
    runs: Sequence[PreparedRun], effects: Mapping[Sensor, Sequence[Effect]]
) -> tuple[dict[Sensor, NoiseModel], list[str]]:
    """Return the noise of the sensors whose runs are long enough, and what is said of others.

    Evidence for an effect is weighed against this noise, so that a guess will not do; ModelError
    where there is no sensor left.
    """
    fitted = {sensor: fit_noise(runs, sensor, effects[sensor]) for sensor in effects}
    found = {s: noise for s, noise in fitted.items() if _is_positive(noise, runs)}
    short = {s: _too_short(runs, s) for s in fitted if s not in found}
    if not found:
        raise ModelError('; '.join(dict.fromkeys(short.values())))
    return found, [f'{sensor}: {text}' for sensor, text in short.items()]


def _is_positive(noise: NoiseModel, runs: Sequence[PreparedRun]) -> bool:
    variance = noise.variance_of_means(runs[0].period)
    return bool(np.isfinite(variance).all() and (variance > 0.0).all())


def _too_short(runs: Sequence[PreparedRun], sensor: Sensor) -> str:
    blocks = [int(np.isfinite(run.measured[sensor]).all(axis=1).sum()) for run in runs]
    period = runs[0].period
    return (
        f'the runs are too short to tell an effect from noise: the longest has {max(blocks)} '
        f'blocks of {period:g} s; {LEAST_BLOCKS} are needed in one run, '
        f'{LEAST_BLOCKS * period / 60.0:g} min after the start-up transient and without gaps'
    )


def noise_beside(
    runs: Sequence[PreparedRun],
    effects: Mapping[Sensor, Sequence[Effect]],
    noise: Mapping[Sensor, NoiseModel],
) -> dict[Sensor, NoiseModel]:
    """Return the noise anew where an effect would else be taken for noise; the rest as given."""
    return {
        sensor: noise_of_runs(runs, sensor, effects[sensor])[0]
        if effects_beyond(runs, sensor, effects[sensor])
        else noise[sensor]
        for sensor in effects
    }


def independent_axes(runs: Sequence[PreparedRun], sensor: Sensor) -> FloatArray | None:
    """Return the (3, 3) orthogonal directions in which the noise is independent.

    They are the principal axes of the differences of neighbouring block means, less what a
    saturated model follows: in them what is slow plays no part. The smaller half of them counts:
    what shakes the device at times is not its noise. None where the axes are independent as they
    are: Bartlett's test, with the price of three correlations.
    """
    steps = []
    for run in runs:
        valid = np.isfinite(run.measured[sensor]).all(axis=1)
        if valid.sum() < LEAST_BLOCKS:
            continue
        projection = projection_of(run, valid, saturated_basis, {})
        left = project_out(projection.basis, run.measured[sensor][valid])
        steps.append(np.diff(left, axis=0)[np.diff(projection.slot) == 1])
    rows = np.concatenate([np.zeros((0, 3)), *steps])
    if len(rows) < LEAST_BLOCKS or not (rows.std(axis=0) > 0.0).all():
        return None
    size = np.linalg.norm(rows / np.maximum(np.median(np.abs(rows), axis=0), 1e-300), axis=1)
    kept = rows[size <= np.median(size)]
    if len(kept) < LEAST_BLOCKS or not (kept.std(axis=0) > 0.0).all():
        return None
    determinant = max(float(np.linalg.det(np.corrcoef(kept.T))), 1e-300)
    # Differences of neighbours share a value: two thirds of them are independent.
    evidence = -(2.0 / 3.0) * len(kept) * np.log(determinant) - 3.0 * np.log(len(kept))
    if evidence < CORRELATED_EVIDENCE:
        return None
    axes: FloatArray = np.linalg.eigh(np.cov(kept.T))[1]
    return axes


def turned_runs(
    runs: Sequence[PreparedRun], sensor: Sensor, axes: FloatArray | None
) -> Sequence[PreparedRun]:
    """Return the runs with one sensor's values (…, 3) along other axes."""
    if axes is None:
        return runs
    return [
        replace(
            run,
            measured={**run.measured, sensor: run.measured[sensor] @ axes},
            fine_measured={**run.fine_measured, sensor: run.fine_measured[sensor] @ axes},
        )
        for run in runs
    ]


def _scatter(runs: Sequence[PreparedRun], sensor: Sensor) -> FloatArray:
    """Return the (3,) standard deviation of block means about a level and a line per run."""
    squares, degrees, largest = np.zeros(3), 0, 0.0
    for run in runs:
        rows = np.isfinite(run.measured[sensor]).all(axis=1)
        values = run.measured[sensor][rows]
        if not len(values):
            continue
        design = np.column_stack([np.ones(len(values)), run.temperature[rows]])
        left = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
        squares += (left**2).sum(axis=0)
        degrees += max(len(values) - 2, 0)
        largest = max(largest, float(np.abs(values).max()))
    scatter: FloatArray = np.sqrt(squares / max(degrees, 1))
    return np.maximum(scatter, max(FINEST_RESOLUTION * largest, 1e-300))
