# SPDX-License-Identifier: Apache-2.0
"""Fit a thermal model: generalised least squares with the noise the data themselves show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

from thermal_comp.conditions import Sensor
from thermal_comp.fit_design import Design, Term
from thermal_comp.fit_directions import ShapeDirection, grain, solve_with_shapes
from thermal_comp.fit_inputs import (
    Effects,
    check_temperature,
    device_of,
    effects_by_sensor,
    sensor_groups,
    usable_sensors,
)
from thermal_comp.fit_shapes import bound_notes, refine_shapes
from thermal_comp.fit_solution import Solution, solve
from thermal_comp.model import NoiseModel, Provenance, SensorModel, ThermalModel
from thermal_comp.noise_of_runs import noise_beside, noise_of_runs
from thermal_comp.preparation import PERIOD, Truth, prepare
from thermal_comp.prepared_run import PreparedRun

__all__ = ['Effects', 'FittedGroup', 'device_of', 'fit', 'fit_prepared', 'usable_sensors']


def fit(
    effects: Effects,
    recordings: Sequence[ImuRecording],
    *,
    pooled: bool = False,
    truth: Truth | None = None,
    period: float = PERIOD,
) -> ThermalModel:
    """Return the model of these effects that fits the recordings of one device best.

    Every run has a level of its own; shape parameters are searched from the values given.
    `pooled` fits one set of coefficients to several devices. `truth` and `period` [s]: as for
    `prepare`; 0 fits single samples.
    """
    if period <= 0:
        from thermal_comp.fit_full_rate import fit_full_rate

        return fit_full_rate(effects, recordings, pooled=pooled, truth=truth)
    return fit_prepared(effects, prepare(recordings, period=period, truth=truth), pooled=pooled)


def fit_prepared(
    effects: Effects,
    runs: Sequence[PreparedRun],
    *,
    pooled: bool = False,
    refine: bool = True,
    noise: Mapping[Sensor, NoiseModel] | None = None,
) -> ThermalModel:
    """Return the fitted model; `refine` False keeps the shape parameters as they are given.

    `noise` saves estimating it again where it is known.
    """
    device = device_of(runs, pooled=pooled)
    low, high = check_temperature(runs)
    sensors, notes = usable_sensors(runs)
    listed = effects_by_sensor(effects, sensors, runs)
    known = noise or {}
    found = {
        s: (known[s], '') if s in known else noise_of_runs(runs, s, listed[s]) for s in sensors
    }
    noise = {s: model for s, (model, _) in found.items()}
    notes += [note for _, note in found.values() if note]
    models: dict[Sensor, SensorModel] = {}
    for group in sensor_groups(listed):
        design = Design(runs, {s: listed[s] for s in group}, noise)
        if refine:
            design = refine_shapes(design)
            notes += bound_notes(design)
        beside = noise_beside(runs, design.effects, design.noise)
        if any(beside[s] is not design.noise[s] for s in beside):
            design = Design(runs, design.effects, beside)
        fitted = fitted_group(design)
        notes += fitted.notes
        for sensor in group:
            models[sensor] = fitted.sensor_model(sensor, (low, high))
    return ThermalModel(
        device=device,
        sensors={s: models[s] for s in sensors},
        reference_temperature=runs[0].conditions.reference_temperature,
        pooled=pooled,
        provenance=Provenance(
            sources={run.name: run.hash for run in runs},
            version=package_version(),
            notes=(*(note for run in runs for note in run.notes), *notes),
        ),
    )


@dataclass(frozen=True, eq=False)
class FittedGroup:
    """Design and solution of the sensors that share coefficients."""

    design: Design
    solution: Solution
    with_shapes: Design
    shape_solution: Solution
    notes: list[str]

    def sensor_model(self, sensor: Sensor, span: tuple[float, float]) -> SensorModel:
        """Return the model of one sensor of the group."""
        design, estimate = self.design, self.solution.estimate[:, 0]
        terms = design.terms_of(sensor)
        unknowns = np.concatenate(
            [np.arange(t.unknowns.start, t.unknowns.stop) for t in terms] or [np.zeros(0, int)]
        )
        covariance = self._covariance(unknowns)
        return SensorModel(
            effects=design.effects[sensor],
            coefficients=tuple(estimate[t.unknowns].reshape(t.shape) for t in terms),
            covariance=covariance,
            noise=design.noise[sensor],
            levels={
                run.name: np.array([estimate[design.level_index(r, sensor, a)] for a in range(3)])
                for r, run in enumerate(design.runs)
                if design.valid(r, sensor).any()
            },
            shape_std=self._shape_std(sensor),
            contributions=self._contributions(sensor),
            temperature_range=span,
        )

    def _covariance(self, unknowns: np.ndarray) -> np.ndarray:
        """Return the covariance of some unknowns, shapes and misfit included.

        Directions of shape parameters come last, so unknowns keep their places.
        """
        covariance = self.shape_solution.covariance[np.ix_(unknowns, unknowns)]
        return np.asarray(covariance * self._misfit())

    def _misfit(self) -> float:
        """χ² per degree of freedom, where it exceeds one."""
        return max(1.0, float(self.solution.chi_square[0]) / self.solution.degrees)

    def _contributions(self, sensor: Sensor) -> dict[str, FloatArray]:
        """Return the (3,) rms of each effect's error about the mean of each run."""
        found: dict[str, FloatArray] = {}
        for term in self.design.terms_of(sensor):
            alone = np.zeros_like(self.solution.estimate[:, 0])
            alone[term.unknowns] = self.solution.estimate[term.unknowns, 0]
            parts = [self.design.predicted(alone, r, sensor) for r in range(len(self.design.runs))]
            centred = np.concatenate([part - part.mean(axis=0) for part in parts])
            found[term.effect.name] = np.sqrt((centred**2).mean(axis=0))
        return found

    def _shape_std(self, sensor: Sensor) -> dict[str, tuple[float, ...]]:
        found: dict[str, tuple[float, ...]] = {}
        for term in self.with_shapes.terms_of(sensor):
            if isinstance(term.effect, ShapeDirection):
                variance = self.shape_solution.covariance[term.start, term.start]
                name = f'{term.effect.of.partition("@")[0]}.{term.effect.parameter}'
                row = grain(self.design, term.effect)
                std = float(np.sqrt(variance * self._misfit() + row**2))
                found[name] = (*found.get(name, ()), std)
        return found


def fitted_group(design: Design) -> FittedGroup:
    """Return the solution of a design whose shape parameters stand."""
    solution = solve(design.equations())
    notes = held_notes(design, solution)
    if not any(term.effect.shape_parameters for term in design.terms):
        return FittedGroup(design, solution, design, solution, notes)
    with_shapes, shape_solution = solve_with_shapes(design, solution.estimate[:, 0])
    return FittedGroup(design, solution, with_shapes, shape_solution, notes)


def held_notes(design: Design, solution: Solution) -> list[str]:
    """Return one sentence per effect and sensor group about what the data cannot determine."""
    sensors = '+'.join(design.sensors)
    notes = []
    for term in design.terms:
        own = range(term.unknowns.start, term.unknowns.stop)
        silent = [j for j in own if j in solution.held and not solution.held[j]]
        dependent = [j for j in own if solution.held.get(j)]
        if silent:
            notes.append(f'{sensors}: {_named(design, term, silent)} is not excited here: zero')
        for j in dependent:
            others = sorted({design.describe(i) for i in solution.held[j]})
            notes.append(
                f'{sensors}: {design.describe(j)} cannot be told apart from '
                f'{", ".join(others)} in these runs; it is held at zero'
            )
    return notes


def _named(design: Design, term: Term, unknowns: list[int]) -> str:
    if len(unknowns) == term.unknowns.stop - term.unknowns.start:
        return term.effect.name
    return ', '.join(design.describe(j) for j in unknowns)


def package_version() -> str:
    """Return the version of this package; '' where it is run from a bare tree."""
    try:
        return version('thermal_comp')
    except PackageNotFoundError:
        return ''
