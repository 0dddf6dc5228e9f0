# SPDX-License-Identifier: Apache-2.0
"""The noise of runs that fits weigh with: fitted, or taken as white where runs are too short."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray
from scipy.linalg import eigh

from thermal_comp.data.blocks import in_blocks
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import orthonormal, project_out
from thermal_comp.model.values import ModelError, NoiseModel
from thermal_comp.noise.estimation import effects_beyond, fit_noise, saturated_model
from thermal_comp.noise.jumps import basis_with_jumps
from thermal_comp.noise.projection import LEAST_BLOCKS, basis_of_rows
from thermal_comp.noise.vibration import SHAKEN_NOISE_RATIO, noise_of_vibration, note_of_vibration
from thermal_comp.noise.whittle import SLOW_SHARE_LN_STD, TYPICAL_SLOW_SHARE

CORRELATED_EVIDENCE = 10.0
"""2 ln of the Bayes factor from which the noise of the axes is correlated."""
LOUD_NOISE_RATIO = 5.0
"""Fitted noise of means, over the usual one, from which it may be an effect fitted as noise."""
LOUD_NOISE_RATIO_OF_FEW = 1.5
"""The same where some run has too few blocks for a saturated model to follow every effect."""
OTHER_WHITE_RATIO = 2.0
"""Ratio of fitted white noise to that of second differences, from which the latter counts."""
LARGEST_AXIS_RATIO = 3.0
"""Ratio of the white noise of an axis to the median of the three, beyond which it is no noise of
the sensor: its axes are made alike."""
LEAST_BENDS = 10
"""Number of second differences that this needs."""
LEAST_COVARIANCE_ROWS = 10
"""Rows a covariance of noise is estimated from, at least."""
LEAST_NOISE_SHARE = 1e-12
"""Least noise of a mean, as a share of the largest value: no measurement resolves more."""


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
    """Return the noise of the sensors whose runs are long enough, and notes on it and the others.

    Evidence for an effect is weighed against this noise, so that it must not be a guess. Raises
    ModelError where no sensor is left.
    """
    fitted = {sensor: fit_noise(runs, sensor, effects[sensor]) for sensor in effects}
    found = {s: noise for s, noise in fitted.items() if _is_positive(noise, runs)}
    short = {s: _too_short(runs, s) for s in fitted if s not in found}
    if not found:
        raise ModelError('; '.join(dict.fromkeys(short.values())))
    shaken = [note_of_vibration(noise, runs, sensor) for sensor, noise in found.items()]
    notes = [f'{sensor}: {text}' for sensor, text in short.items()]
    return found, [*notes, *(note for note in shaken if note)]


def _is_positive(noise: NoiseModel, runs: Sequence[PreparedRun]) -> bool:
    variance = noise.variance_of_means(runs[0].period)
    return bool(np.isfinite(variance).all() and (variance > 0.0).all())


def _too_short(runs: Sequence[PreparedRun], sensor: Sensor) -> str:
    blocks = [int(run.valid(sensor).sum()) for run in runs]
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
    """Return the noise, fitted anew where an effect of the list would be taken for noise."""
    return {
        sensor: noise_of_runs(runs, sensor, effects[sensor])[0]
        if effects_beyond(runs, sensor, effects[sensor])
        else noise[sensor]
        for sensor in effects
    }


def independent_axes(runs: Sequence[PreparedRun], sensor: Sensor) -> FloatArray | None:
    """Return (3, 3) directions in which the noise is independent, still and shaken alike.

    They follow from differences of neighbouring block means, or of successive bursts of one block
    each, less what a saturated model follows: slow noise plays no part in them. Of the still ones
    the smaller half counts, so that knocks at the device do not. Vibration has a direction of its
    own: the axes are those in which the covariances of still and of shaken rows are both diagonal
    (generalised eigenvectors), of unit length; without vibration they are orthogonal. None where
    the sensor's own axes are independent: Bartlett's test, less a charge for three correlations.
    """
    model = saturated_model(runs, sensor)
    vibration = noise_of_vibration(runs, sensor, model, [{}] * len(runs))
    steps, neighbours, strength = [np.zeros((0, 3))], [np.zeros(0, bool)], [np.zeros(0)]
    for run in runs:
        valid = run.valid(sensor)
        if valid.sum() < LEAST_BLOCKS:
            continue
        shaking = vibration.shaking(run, valid)
        weights = np.ones(int(valid.sum())) if shaking is None else shaking.weights
        basis = basis_of_rows(run, valid, model, {}, shaking)
        weighted = weights[:, None] * run.measured[sensor][valid]
        left = project_out(basis_with_jumps(weighted, run.slot[valid], basis, weights), weighted)
        steps.append(np.diff(left / weights[:, None], axis=0))
        apart = np.diff(run.slot[valid])
        neighbours.append(apart <= np.median(apart))
        strength.append(0.5 * (weights[1:] ** -2.0 + weights[:-1] ** -2.0))
    step, variance = np.concatenate(steps), np.concatenate(strength)
    shaken = variance > SHAKEN_NOISE_RATIO**2
    rows = step[np.concatenate(neighbours) & ~shaken]
    if not (len(rows) and (rows.std(axis=0) > 0.0).all()):
        return None
    size = np.linalg.norm(rows / np.maximum(np.median(np.abs(rows), axis=0), 1e-300), axis=1)
    still = _covariance(rows[size <= np.median(size)])
    if still is None:
        return None
    moved = _covariance(step[shaken] / np.sqrt(variance[shaken])[:, None])
    if moved is None:
        return None if _is_diagonal(still) else np.asarray(np.linalg.eigh(still)[1])
    if _is_diagonal(still) and _is_diagonal(moved):
        return None
    axes: FloatArray = eigh(moved, still)[1]
    return axes / np.linalg.norm(axes, axis=0)


def usual_noise(
    runs: Sequence[PreparedRun], sensor: Sensor, fitted: NoiseModel
) -> NoiseModel | None:
    """Return the noise a sensor usually has; None where the fitted one is hardly louder.

    An effect that no saturated model follows is fitted as noise where rows are few or it is large.
    White noise is the fitted one, or that of the median second difference of successive blocks
    where they differ much; slow noise is as large beside it as is typical of MEMS sensors.
    """
    told = _white_of_neighbours(runs, sensor, fitted)
    if told is None:
        return None
    other = (fitted.white > OTHER_WHITE_RATIO * told) | (OTHER_WHITE_RATIO * fitted.white < told)
    white = np.where(other, told, fitted.white)
    white = np.minimum(white, LARGEST_AXIS_RATIO * np.median(white))
    slow = np.tile(TYPICAL_SLOW_SHARE * white, (len(fitted.time_constants), 1))
    usual = replace(fitted, white=white, amplitudes=slow)
    period = runs[0].period
    follows = saturated_model(runs, sensor).follows_any_effect
    ratio = LOUD_NOISE_RATIO if all(map(follows, runs)) else LOUD_NOISE_RATIO_OF_FEW
    loud = fitted.variance_of_means(period) > ratio**2 * usual.variance_of_means(period)
    return usual if loud.any() else None


def _white_of_neighbours(
    runs: Sequence[PreparedRun], sensor: Sensor, noise: NoiseModel
) -> FloatArray | None:
    """Return the (3,) white noise of a one-second mean by second differences of blocks [unit].

    Where hardly any blocks follow each other, as in bursts, by those of the rows within them. None
    where there are too few of these as well, or half of them are zero.
    """
    bends = np.concatenate([_bends(run, sensor, noise) for run in runs])
    if len(bends) < LEAST_BENDS:
        # What vibration adds was fitted to whole blocks: that of single rows scatters more.
        still = replace(noise, per_vibration=np.zeros(3))
        bends = np.concatenate([_bends(in_blocks(run, 0.0), sensor, still) for run in runs])
    if len(bends) < LEAST_BENDS:
        return None
    white: FloatArray = 1.4826 * np.median(bends, axis=0)
    return white if (white > 0.0).all() else None


def _bends(run: PreparedRun, sensor: Sensor, noise: NoiseModel) -> FloatArray:
    """Return (k, 3) sizes of second differences of blocks that follow each other [unit].

    Each is scaled to the standard deviation of a one-second mean at rest.
    """
    values, period = run.measured[sensor], run.period
    still = np.maximum(noise.variance_of_means(period), 1e-300)
    added = np.broadcast_to(noise.added_by(run.vibration, period), values.shape) / still
    variance = (added[2:] + 4.0 * added[1:-1] + added[:-2]) / 6.0 + 1.0
    bend = np.abs(np.diff(values, 2, axis=0)) * np.sqrt(period / (6.0 * variance))
    in_row = (run.slot[2:] - run.slot[:-2] == 2) & np.isfinite(bend).all(axis=1)
    found: FloatArray = bend[in_row] / noise.white_factors.get(run.name, 1.0)
    return found


def log_prior_of_loudness(noise: NoiseModel, usual: NoiseModel, period: float) -> float:
    """Return ln of the prior of noise relative to the usual one; 0 where it is not louder.

    ln of the ratio has a part that is common to the axes and one of each, equally wide.
    """
    ratio = noise.variance_of_means(period) / usual.variance_of_means(period)
    louder = 0.5 * np.log(np.maximum(ratio, 1.0)) / SLOW_SHARE_LN_STD
    covariance = np.eye(3) + 1.0
    return -0.5 * float(louder @ np.linalg.solve(covariance, louder))


def _covariance(rows: FloatArray) -> FloatArray | None:
    """Return the (3, 3) covariance of rows, diagonal where axes do not correlate beyond chance.

    None where there are too few rows.
    """
    if len(rows) < LEAST_COVARIANCE_ROWS or not (rows.std(axis=0) > 0.0).all():
        return None
    covariance: FloatArray = np.cov(rows.T)
    determinant = max(float(np.linalg.det(np.corrcoef(rows.T))), 1e-300)
    # Differences of neighbours share a value: two thirds of them are independent.
    evidence = -(2.0 / 3.0) * len(rows) * np.log(determinant) - 3.0 * np.log(len(rows))
    return covariance if evidence >= CORRELATED_EVIDENCE else np.diag(np.diag(covariance))


def _is_diagonal(covariance: FloatArray) -> bool:
    return not np.any(covariance - np.diag(np.diag(covariance)))


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
        rows = run.valid(sensor)
        values = run.measured[sensor][rows]
        if not len(values):
            continue
        design = np.column_stack([np.ones(len(values)), run.temperature[rows]])
        left = project_out(orthonormal(design), values)
        squares += (left**2).sum(axis=0)
        degrees += max(len(values) - 2, 0)
        largest = max(largest, float(np.abs(values).max()))
    scatter: FloatArray = np.sqrt(squares / max(degrees, 1))
    return np.maximum(scatter, max(LEAST_NOISE_SHARE * largest, 1e-300))
