# SPDX-License-Identifier: Apache-2.0
"""All coefficients and shape parameters of a sensor's model, linear about where they stand.

It answers two questions by least squares: how much do they change where they are fitted to a part
of the data, and how much with an error of the data?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from imu_recording.recording import FloatArray, IntArray
from numpy.typing import NDArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect, shape_bounds
from thermal_comp.model.values import SensorModel

LARGEST_CONDITION = 300.0
"""Condition of scaled columns above which a part of the data determines nothing by itself."""
LEAST_RESOLUTION = 0.99
"""Diagonal of the resolution matrix from which on rows determine an unknown by themselves."""


@dataclass(frozen=True)
class Shape:
    """One value of a shape parameter of the sensor model's effect number `effect`."""

    effect: int
    name: str
    place: int | None
    """Index into a tuple of values; None for a single value."""
    value: float
    std: float
    """Standard uncertainty of the fit [its unit]."""
    form: float
    """Standard uncertainty of the effect's equation [its unit]; 0 where it is not known."""
    unit: str
    label: str
    """Name of the effect and of the parameter, numbered where it has several values."""

    def moved(self, effect: Effect, value: float) -> Effect:
        """Return the effect with another value."""
        if self.place is None:
            return replace(effect, **{self.name: value})
        values = list(getattr(effect, self.name))
        values[self.place] = value
        changed: dict[str, tuple[float, ...]] = {self.name: tuple(values)}
        return replace(effect, **changed)


def shape_labels(effect: str, parameter: str, count: int) -> list[str]:
    """Return the labels of the values of a shape parameter.

    >>> shape_labels('thermal_hysteresis', 'half_widths', 2)[1]
    'thermal_hysteresis: half_widths 2 of 2'
    """
    name = f'{effect}: {parameter}'
    return [name] if count == 1 else [f'{name} {k + 1} of {count}' for k in range(count)]


def fitted_values(model: SensorModel) -> list[Shape]:
    """Return every value of a fitted shape parameter whose uncertainty the model has."""
    found = []
    for i, effect in enumerate(model.effects):
        for item in effect.free_parameters:
            key = f'{effect.name}.{item.name}'
            spread = np.array(model.shape_std.get(key, ()))
            forms = np.array(model.shape_form_std.get(key, np.zeros(len(spread))))
            spread = np.sqrt(np.maximum(spread**2 - forms**2, 0.0))
            value, unit = getattr(effect, item.name), item.metadata['unit']
            several = isinstance(value, tuple)
            values = value if several else [value]
            labels = shape_labels(effect.name, item.name, len(values))
            stds = zip(values, spread.tolist(), forms.tolist(), strict=False)
            for place, (one, std, form) in enumerate(stds):
                if std > 0.0 and np.isfinite(std):
                    at = place if several else None
                    label = labels[place]
                    found.append(
                        Shape(
                            effect=i,
                            name=item.name,
                            place=at,
                            value=float(one),
                            std=std,
                            form=form,
                            unit=unit,
                            label=label,
                        )
                    )
    return found


@dataclass(frozen=True, eq=False)
class JointDesign:
    """Columns of q unknowns over the n blocks of all runs, and what the model leaves there."""

    columns: FloatArray
    """(n, 3, q) change of the modelled error with each unknown: coefficients in the order of the
    model's covariance, then shape parameters."""
    residual: FloatArray
    """(n, 3) measured minus the run's level and all modelled effects, campaign's too [unit]."""
    deviation: FloatArray
    """(3,) of the noise of a block; weights the axes [unit]."""
    run: IntArray
    """(n,) number of the run."""
    part: IntArray
    """(n,) part of the run that is held out together; 0 none."""
    temperature: FloatArray
    """(n,) [°C]."""
    shapes: tuple[Shape, ...]
    coefficients: int
    """How many unknowns are coefficients."""

    @classmethod
    def of(cls, model: SensorModel, runs: Sequence[PreparedRun], sensor: Sensor) -> JointDesign:
        """Return the design of a sensor's model over runs."""
        assert model.noise is not None  # noqa: S101 (every fit has one)
        shapes = tuple(fitted_values(model))
        variance = model.noise.variance_of_means(runs[0].period)
        size = sum(c.size for c in model.coefficients)
        pieces, residual = [], []
        every = np.concatenate([np.zeros(0), *(c.ravel() for c in model.coefficients)])
        for run in runs:
            own = [
                coefficient_columns(run.smoothed, sensor, effect, values, place_of(run, model))
                for effect, values in zip(model.effects, model.coefficients, strict=True)
            ]
            linear = np.concatenate([np.zeros((len(run), 3, 0)), *own], axis=2)
            bent = [_shape_column(run.smoothed, sensor, model, shape) for shape in shapes]
            pieces.append(np.concatenate([linear, *(c[:, :, None] for c in bent)], axis=2))
            left = run.measured[sensor] - linear @ every
            residual.append(left - model.levels.get(run.name, np.nanmean(left, axis=0)))
        return cls(
            np.concatenate(pieces),
            np.concatenate(residual),
            np.where(variance > 0.0, np.sqrt(variance), 1.0),
            np.concatenate([np.full(len(run), r) for r, run in enumerate(runs)]),
            np.concatenate([run.cv_group for run in runs]),
            np.concatenate([run.temperature for run in runs]),
            shapes,
            size,
        )

    @cached_property
    def everything(self) -> NDArray[np.bool_]:
        """(n,) the rows that all axes were measured in."""
        good: NDArray[np.bool_] = np.isfinite(self.residual).all(axis=1)
        return good

    @cached_property
    def whole(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """The solver of all rows, as `_solver` gives it."""
        return self._solver(self.everything)

    def response(self, error: FloatArray) -> FloatArray:
        """(q,) change of the unknowns with an error (n, 3) of the data [unit]."""
        solver, _ = self.whole
        change: FloatArray = solver @ self._centred(error, self.everything)
        return change

    def changes(self, rows: NDArray[np.bool_]) -> FloatArray:
        """(q,) change of the unknowns fitted to some rows alone; NaN: not determined."""
        rows = rows & self.everything
        if rows.sum() < 4 * (self.columns.shape[2] + 1):
            return np.full(self.columns.shape[2], np.nan)
        solver, told = self._solver(rows)
        return np.where(told, solver @ self._centred(self.residual, rows), np.nan)

    @cached_property
    def by_part(self) -> tuple[FloatArray, IntArray]:
        """(k, q) changes by each part of each run alone, NaN: not determined; and runs (k,)."""
        found, run = [], []
        for r in np.unique(self.run):
            of_run = self.run == r
            for number in np.unique(self.part[of_run & (self.part > 0)]):
                found.append(self.changes(of_run & (self.part == number)))
                run.append(r)
        return np.array(found).reshape(-1, self.columns.shape[2]), np.array(run, int)

    @cached_property
    def by_cycle(self) -> FloatArray:
        """(k, q) changes by the same part of all runs, NaN where not determined."""
        numbers = np.unique(self.part[self.part > 0])
        found = [self.changes(self.part == number) for number in numbers]
        return np.array(found).reshape(-1, self.columns.shape[2])

    def scatter_of(self, unknown: int) -> tuple[FloatArray, IntArray]:
        """Return (k,) changes of an unknown by parts that determine it, and their (k,) runs.

        Where no part of a run does alone, a part of all runs together counts as one.
        """
        values, run = self.by_part
        told = np.isfinite(values[:, unknown])
        if told.sum() > 1:
            return values[told, unknown], run[told]
        together = self.by_cycle[:, unknown]
        together = together[np.isfinite(together)]
        return together, np.zeros(len(together), int)

    def _solver(self, rows: NDArray[np.bool_]) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the (q, 3m) pseudo-inverse of the centred rows, and unknowns they determine."""
        count = self.columns.shape[2]
        design = self._centred(self.columns, rows).reshape(-1, count)
        norm = np.sqrt((design**2).sum(axis=0))
        scale = np.where(norm > 0.0, norm, 1.0)
        inverse = np.linalg.pinv(design / scale, rcond=1.0 / LARGEST_CONDITION)
        told = (norm > 0.0) & (np.diag(inverse @ (design / scale)) > LEAST_RESOLUTION)
        return inverse / scale[:, None], told

    def _centred(self, values: FloatArray, rows: NDArray[np.bool_]) -> FloatArray:
        """Return (m, 3, …) rows about the mean of their run, in deviations of noise, raveled."""
        taken, run = values[rows].copy(), self.run[rows]
        for r in np.unique(run):
            taken[run == r] -= taken[run == r].mean(axis=0)
        taken /= self.deviation.reshape(1, 3, *[1] * (taken.ndim - 2))
        return taken.reshape(-1, *taken.shape[2:])


def place_of(run: PreparedRun, model: SensorModel) -> int | None:
    """Return the place of a run among those the model was fitted to, None where it is another."""
    names = list(model.levels)
    return names.index(run.name) if run.name in names else None


def coefficient_columns(
    run: PreparedRun, sensor: Sensor, effect: Effect, values: FloatArray, place: int | None
) -> FloatArray:
    """(m, 3, size) columns of an effect's coefficients in a run, raveled in C order.

    `place`: as `place_of`; coefficients that runs have of their own do nothing in another run.
    """
    block = np.zeros((len(run), 3, *values.shape))
    flat = block.reshape(len(run), 3, -1)
    if not all(run.conditions.has(channel) for channel in effect.needs):
        return flat
    if effect.per_run and (place is None or place >= len(values)):
        return flat
    own = block[:, :, place] if effect.per_run else block
    columns = run.columns(effect, sensor)
    if own.ndim == 3:  # shared by the axes
        own[...] = columns if columns.ndim == 3 else columns[:, None]
        return flat
    for axis in range(3):
        own[:, axis, :, axis] = columns[:, axis] if columns.ndim == 3 else columns
    return flat


def modelled(
    run: PreparedRun, sensor: Sensor, model: SensorModel, without: Sequence[int]
) -> FloatArray:
    """(m, 3) error of all effects of a model but some, those of the campaign with it."""
    error = np.zeros((len(run), 3))
    place = place_of(run, model)
    for i, (effect, values) in enumerate(zip(model.effects, model.coefficients, strict=True)):
        if i not in without:
            error += coefficient_columns(run, sensor, effect, values, place) @ values.ravel()
    return error


def _shape_column(
    run: PreparedRun, sensor: Sensor, model: SensorModel, shape: Shape
) -> FloatArray:
    """(m, 3) change of the modelled error with a shape parameter, over one deviation each way."""
    effect, values = model.effects[shape.effect], model.coefficients[shape.effect]
    low, high = next(shape_bounds(f) for f in fields(effect) if f.name == shape.name)
    ends = [min(max(shape.value + by, low), high) for by in (-shape.std, shape.std)]
    place = place_of(run, model)
    below, above = (
        coefficient_columns(run, sensor, shape.moved(effect, end), values, place) @ values.ravel()
        for end in ends
    )
    change: FloatArray = (above - below) / (ends[1] - ends[0])
    return change
