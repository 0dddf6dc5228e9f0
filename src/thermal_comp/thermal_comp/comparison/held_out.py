# SPDX-License-Identifier: Apache-2.0
"""Error on parts of the runs that the fit has not seen, and what noise alone would leave there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.linear.columns import orthonormal, project_out
from thermal_comp.linear.design import Design
from thermal_comp.linear.normal_equations import Solution, solve
from thermal_comp.linear.whitening import apply_transposed
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.covariance import block_variances, noise_product

LEAST_POWER_SHARE = 0.02
"""Share of a column's power in the rest of the runs below which they do not determine its
coefficient: a block over two cycles has a little of both."""
LEAST_LEVEL_POWER_SHARE = 0.2
"""The same for a level of a part of a run: half an hour after the last cycle hardly determines the
level of that cycle."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Held-out errors of a group of sensors, block by block; NaN where none was held out."""

    errors: Mapping[tuple[int, Sensor], FloatArray]
    """(m, 3) measured minus predicted, by run number and sensor [unit]."""
    variances: Mapping[tuple[int, Sensor], FloatArray]
    """(m, 3) expectation of their squares if the noise were all that is left [unit²]."""
    parts: Sequence[IntArray] = ()
    """(m,) part of each block, by run; 0 is never held out."""
    relearned: tuple[str, ...] = ()
    """Coefficients that only the held-out part determines, taken from it like a level."""

    def rms(self, sensor: Sensor) -> FloatArray:
        """(3,) held-out rms per axis."""
        return np.sqrt(_mean([v**2 for (_, s), v in self.errors.items() if s == sensor]))

    def floor(self, sensor: Sensor) -> FloatArray:
        """(3,) held-out rms per axis that the noise alone leads to expect.

        It is the noise of a block and the error it makes in the levels and a line in temperature,
        whatever the model: the error of further coefficients is not allowed for. Levels are those
        of the runs and, where the model has them, of parts of runs. With the noise of
        `noise_of_model` it holds for these very runs, slow noise included.
        """
        return np.sqrt(_mean([v for (_, s), v in self.variances.items() if s == sensor]))


@kept
def hold_out(
    runs: Sequence[PreparedRun],
    effects: Mapping[Sensor, tuple[Effect, ...]],
    noise: Mapping[Sensor, NoiseModel],
) -> HeldOut:
    """Leave each part out of all runs in turn, fit the rest and predict it.

    Levels come from the rest of the run, shape parameters stay as given. The fit to the rest is
    without the noise of the thermometer; the prediction has it, as where a model is applied.
    """
    measured = Design(runs, effects, noise)
    design = Design([run.smoothed for run in runs], effects, noise)
    held, power = solve(design.equations()).held, _power(design)
    errors, variances = _empty(design), _empty(design)
    relearned: set[str] = set()
    for part in sorted({int(k) for run in runs for k in run.cv_group if k > 0}):
        training = design.over([run.cv_group != part for run in runs])
        solution = solve(training.weighted.equations())
        line = training.with_effects({s: _levels_and_line(effects[s]) for s in effects})
        line_solution = solve(line.equations())
        unseen = [j for j in _unseen(training, power) if j not in held]
        told = [training.describe(j) for j in unseen if j >= training.levels]
        relearned |= {text.partition(' ')[0].partition('[')[0] for text in told}
        for run, sensor, rows in _held_out_rows(design, training, part):
            error = _errors(measured, solution, run, sensor)[rows]
            for axis in range(3):
                basis = _local_basis(training, unseen, run, sensor, axis)[rows]
                error[:, axis] = project_out(basis, error[:, axis])
                variances[run, sensor][rows, axis] = _expected(
                    line, line_solution, (run, sensor, axis), rows, basis
                )
            errors[run, sensor][rows] = error
    parts = [run.cv_group for run in runs]
    return HeldOut(
        errors=errors, variances=variances, parts=parts, relearned=tuple(sorted(relearned))
    )


def _held_out_rows(
    design: Design, training: Design, part: int
) -> Iterator[tuple[int, Sensor, NDArray[np.bool_]]]:
    """Yield run, sensor and (m,) blocks of a part, where the rest of the run tells its level."""
    for number, run in enumerate(design.runs):
        for sensor in design.sensors:
            rows = (run.cv_group == part) & design.valid(number, sensor)
            if rows.any() and training.valid(number, sensor).any():
                yield number, sensor, rows


def _unseen(training: Design, power: FloatArray) -> list[int]:
    """Return the unknowns of which the training parts hold too small a share of the power."""
    least = np.full(training.size, LEAST_POWER_SHARE)
    for term in training.terms:
        if term.effect.per_run:
            least[term.unknowns] = LEAST_LEVEL_POWER_SHARE
        if term.effect.coefficient_deviations() is not None:
            least[term.unknowns] = 0.0  # its prior tells them
    seen = _power(training) / np.maximum(power, 1e-300)
    return [int(j) for j in np.flatnonzero(seen < least)]


def _levels_and_line(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    return (BiasTemperature(), *(e for e in effects if e.per_run))


def _power(design: Design) -> FloatArray:
    """Return the sum of squares of every unknown's column over the blocks that take part."""
    power = np.zeros(design.size)
    for run in range(len(design.runs)):
        for sensor in design.sensors:
            for axis in range(3):
                index, columns = design.raw_columns(run, sensor, axis)
                power[index] += (columns[design.valid(run, sensor)] ** 2).sum(axis=0)
    return power


def _empty(design: Design) -> dict[tuple[int, Sensor], FloatArray]:
    return {
        (r, s): np.full((len(run), 3), np.nan)
        for r, run in enumerate(design.runs)
        for s in design.sensors
    }


def _mean(parts: list[FloatArray]) -> FloatArray:
    together = np.concatenate(parts)
    with np.errstate(invalid='ignore'):
        mean: FloatArray = np.nansum(together, axis=0) / np.isfinite(together).sum(axis=0)
    return mean


def _errors(design: Design, solution: Solution, run: int, sensor: Sensor) -> FloatArray:
    """Return measured minus predicted, (m, 3), over all blocks of a run."""
    estimate = solution.estimate[:, 0]
    error: FloatArray = (
        design.runs[run].measured[sensor]
        - design.predicted(estimate, run, sensor)
        - design.offsets(estimate, run, sensor)
    )
    return error


def _local_basis(
    design: Design, unseen: list[int], run: int, sensor: Sensor, axis: int
) -> FloatArray:
    """Return an orthonormal basis (m, q) of the columns that only the held-out part determines."""
    index, columns = design.raw_columns(run, sensor, axis)
    return orthonormal(columns[:, np.isin(index, unseen)])


def _expected(
    design: Design,
    solution: Solution,
    piece: tuple[int, Sensor, int],
    rows: NDArray[np.bool_],
    basis: FloatArray,
) -> FloatArray:
    """Return the expected square of the prediction error of the held-out rows of one axis.

    cov(w − Xθ̂) = S − X C Gᵀ − G C Xᵀ + X C Xᵀ with θ̂ from the training rows,
    C = (X_tᵀ S_t⁻¹ X_t)⁻¹, G = S_ht S_t⁻¹ X_t; then `basis` (rows, q) is projected out.
    """
    run, sensor, axis = piece
    prepared = design.runs[run]
    index, columns = design.raw_columns(run, sensor, axis)
    valid = design.valid(run, sensor)
    weights = np.zeros_like(columns)
    weights[valid] = apply_transposed(
        design.whitened(columns[valid], run, sensor, axis),
        design.whitening(sensor).gains_of(run, axis),
    )
    noise = design.noise[sensor]
    shared = noise_product(noise, prepared, axis, weights)[rows]
    held = columns[rows]
    covariance = solution.covariance[np.ix_(index, index)]
    own = block_variances(noise, prepared)[rows, axis]
    expected: FloatArray = own + ((held @ covariance) * (held - 2.0 * shared)).sum(axis=1)
    if basis.shape[1]:
        turned = noise_product(noise, prepared, axis, basis, rows)
        turned += held @ (covariance @ ((held - shared).T @ basis))
        turned -= shared @ (covariance @ (held.T @ basis))
        inner = basis @ (basis.T @ turned)
        expected = expected + (basis * (inner - 2.0 * turned)).sum(axis=1)
    return np.maximum(expected, 0.0)
