# SPDX-License-Identifier: Apache-2.0
"""The same coefficients from each thermal cycle alone: what repeats, and what differs by run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.model.values import SensorModel

from imu_workbench.report.certificate.joint_design import LARGEST_CONDITION, modelled


@dataclass(frozen=True, eq=False)
class Replicates:
    """Level and coefficients of each part of each run, thermal cycles where there are any.

    Columns are in the order of `terms`, levels of their own.
    """

    run: IntArray
    """(k,) number of the run of each part."""
    level: FloatArray
    """(k, 3) output at the reference temperature [unit]."""
    coefficients: FloatArray
    """(k, q, 3) of the columns of the terms."""
    terms: tuple[tuple[int, int], ...]
    """(q,) place of each column: effect of the sensor model, column of the effect."""
    parts: str = 'cycles'
    """What the parts are called."""

    def of(self, effect: int, column: int) -> FloatArray | None:
        """(k, 3) replicates of a coefficient, None where a cycle alone does not determine it."""
        if (effect, column) not in self.terms:
            return None
        return self.coefficients[:, self.terms.index((effect, column))]


def own_terms(model: SensorModel, runs: Sequence[PreparedRun], sensor: Sensor) -> list[int]:
    """Return the effects whose coefficients a cycle alone determines, each axis for itself."""
    return [
        i
        for i, effect, coefficients in model.device_terms()
        if coefficients.ndim == 2
        and not (effect.per_run or effect.coupled or effect.time_only)
        and all(run.conditions.has(c) for run in runs for c in effect.needs)
        and runs[0].columns(effect, sensor).ndim == 2
    ]


def replicates(model: SensorModel, runs: Sequence[PreparedRun], sensor: Sensor) -> Replicates:
    """Return level and coefficients of every part by ordinary least squares, shapes as fitted.

    Terms that no single part determines stay as the model has them.
    """
    own = own_terms(model, runs, sensor)
    parts = [(r, *_columns(model, run, sensor, own), run.cv_group) for r, run in enumerate(runs)]
    width = parts[0][1].shape[1] if parts else 0
    terms = tuple((i, j) for i in own for j in range(len(model.coefficients[i])))
    found: list[tuple[int, FloatArray]] = []
    for r, columns, rest, group in parts:
        good = np.isfinite(rest).all(axis=1)
        for number in np.unique(group[group > 0]):
            rows = good & (group == number)
            solved = _solved(columns[rows], rest[rows])
            if solved is not None:
                found.append((r, solved))
    values = np.array([v for _, v in found]).reshape(-1, width + 1, 3)
    number = np.array([r for r, _ in found], int)
    kind = 'cycles' if all(run.has_cycles for run in runs) else 'parts of a run'
    return Replicates(
        run=number, level=values[:, 0], coefficients=values[:, 1:], terms=terms, parts=kind
    )


def _columns(
    model: SensorModel, run: PreparedRun, sensor: Sensor, own: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Return the (m, q) columns of the terms and the (m, 3) measurement without all others."""
    columns = [run.columns(model.effects[i], sensor) for i in own]
    rest = run.measured[sensor] - modelled(run, sensor, model, without=own)
    return np.column_stack([np.empty((len(run), 0)), *columns]), rest


def _solved(columns: FloatArray, values: FloatArray) -> FloatArray | None:
    """Return (1 + q, 3) level and coefficients, None where the rows do not determine them."""
    if len(values) < 4 * (columns.shape[1] + 1):
        return None
    spread = columns.std(axis=0)
    if not (spread > 0.0).all():
        return None
    centre = columns.mean(axis=0)
    scaled = (columns - centre) / spread
    if columns.shape[1] and np.linalg.cond(scaled) > LARGEST_CONDITION:
        return None
    coefficients = np.linalg.lstsq(scaled, values - values.mean(axis=0), rcond=None)[0]
    coefficients = coefficients / spread[:, None]
    level = values.mean(axis=0) - centre @ coefficients
    return np.vstack([level, coefficients])
