# SPDX-License-Identifier: Apache-2.0
"""Fit a thermal model: generalised least squares with the noise the data themselves show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray, ImuRecording

from thermal_comp.data.conditions import SENSORS, Sensor
from thermal_comp.data.parts_at_rest import all_parts_at_rest
from thermal_comp.data.preparation import Truth, prepare, resting_conditions
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.data.startup import cut_startup
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.inputs import (
    Effects,
    check_temperature,
    device_of,
    effects_by_sensor,
    sensor_groups,
    usable_sensors,
)
from thermal_comp.fitting.prediction import with_live_forms
from thermal_comp.fitting.shape_search import bound_notes, refine_shapes
from thermal_comp.fitting.shape_uncertainty import (
    ShapeDirection,
    resolution_std,
    solve_with_shapes,
)
from thermal_comp.fitting.weights import notes_of_weights, solved, with_best_weights
from thermal_comp.linear.design import LEAST_DEVIATION, Design, Term
from thermal_comp.linear.normal_equations import (
    NormalEquations,
    Solution,
    gram,
    pseudo_solve,
    solve,
)
from thermal_comp.model.values import NoiseModel, Provenance, SensorModel, ThermalModel
from thermal_comp.noise.covariance import noise_product
from thermal_comp.noise.of_runs import noise_beside, noise_of_runs
from thermal_comp.noise.vibration import note_of_vibration


def fit(
    effects: Effects,
    recordings: Sequence[ImuRecording],
    *,
    pooled: bool = False,
    truth: Truth | None = None,
    period: float | None = None,
) -> ThermalModel:
    """Return the model of these effects that fits the recordings of one device best.

    Every run has a level of its own; shape parameters are searched from the values given.
    `pooled` fits one set of coefficients to several devices. `truth` and `period` [s]: as for
    `prepare`; 0 fits single samples.
    """
    if period is not None and period <= 0:
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
    temperature_range = check_temperature(runs)
    sensors, left_out = usable_sensors(runs)
    listed = effects_by_sensor(effects, sensors, runs)
    weights, guessed = _noise_by_sensor(runs, listed, noise or {})
    if refine:
        listed = {s: with_live_forms(runs, s, listed[s], weights[s]) for s in listed}
    without_noise = [run.smoothed for run in runs]
    weights = with_best_weights(runs, listed, weights)
    groups = [
        _fit_group(
            Design(without_noise, {s: listed[s] for s in group}, weights), runs, refine=refine
        )
        for group in sensor_groups(listed)
    ]
    models = {s: g.sensor_model(s, temperature_range) for g in groups for s in g.design.sensors}
    weighed = notes_of_weights({s: g.design.noise[s] for g in groups for s in g.design.sensors})
    notes = [note for run in runs for note in run.notes] + left_out + guessed + weighed
    return ThermalModel(
        device=device,
        sensors={s: models[s] for s in sensors},
        reference_temperature=runs[0].conditions.reference_temperature,
        pooled=pooled,
        provenance=Provenance(
            sources={run.name: run.hash for run in runs},
            version=package_version(),
            notes=(*notes, *(note for group in groups for note in group.notes)),
        ),
    )


def _noise_by_sensor(
    runs: Sequence[PreparedRun],
    effects: Mapping[Sensor, Sequence[Effect]],
    known: Mapping[Sensor, NoiseModel],
) -> tuple[dict[Sensor, NoiseModel], list[str]]:
    """Return the noise of each sensor, as known or fitted, and notes on it."""
    found = {
        s: (known[s], '') if s in known else noise_of_runs(runs, s, effects[s]) for s in effects
    }
    notes = [note or note_of_vibration(noise, runs, s) for s, (noise, note) in found.items()]
    return {s: noise for s, (noise, _) in found.items()}, [note for note in notes if note]


def _fit_group(design: Design, runs: Sequence[PreparedRun], *, refine: bool) -> FittedGroup:
    """Return the fit of sensors that share coefficients: shapes, noise beside them, coefficients.

    `runs` are the design's as they were measured, thermometer noise included.
    """
    if refine:
        design = design.with_effects(refine_shapes(design.weighted).effects)
    at_bounds = bound_notes(design) if refine else []
    beside = noise_beside(runs, design.effects, design.noise)
    if any(beside[s] is not design.noise[s] for s in beside):
        weights = with_best_weights(runs, design.effects, beside)
        design = Design(design.runs, design.effects, weights)
    fitted = fitted_group(design)
    return replace(fitted, notes=[*at_bounds, *fitted.notes])


@dataclass(frozen=True, eq=False)
class FittedGroup:
    """Design and solution of the sensors that share coefficients."""

    design: Design
    solution: Solution
    with_shapes: Design
    """The design with a column for each shape parameter, behind the others."""
    shape_solution: Solution
    notes: list[str]
    """What the data cannot determine."""

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
        """Return the covariance of some unknowns, uncertain shapes and misfit included.

        Columns of shape parameters come last, so that unknowns keep their places.
        """
        covariance = self.shape_solution.covariance[np.ix_(unknowns, unknowns)]
        return np.asarray(covariance * self._misfit())

    def _misfit(self) -> float:
        """Return χ² per degree of freedom, at least one."""
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
                row = resolution_std(self.design, term.effect)
                std = float(np.sqrt(variance * self._misfit() + row**2))
                found[name] = (*found.get(name, ()), std)
        return found


def fitted_group(design: Design) -> FittedGroup:
    """Return the solution of a design at its shape parameters."""
    solution = solved(design)
    notes = held_notes(design, solution)
    if not any(term.effect.shape_parameters for term in design.terms):
        with_shapes, shape_solution = design, solution
    else:
        with_shapes, shape_solution = solve_with_shapes(design, solution.estimate[:, 0])
    return FittedGroup(
        design=design,
        solution=solution,
        with_shapes=with_shapes,
        shape_solution=shape_solution,
        notes=notes,
    )


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


def fit_full_rate(
    effects: Effects,
    recordings: Sequence[ImuRecording],
    *,
    pooled: bool = False,
    truth: Truth | None = None,
) -> ThermalModel:
    """Return the fit to single samples instead of block means.

    Noise, shape parameters and whatever shares coefficients between axes come from block means;
    per-axis coefficients then from all samples at once.
    """
    if truth is None:
        recordings = all_parts_at_rest(recordings)
    runs = prepare(recordings, truth=truth)
    model = fit_prepared(effects, runs, pooled=pooled)
    sensors = dict(model.sensors)
    for listed in {m.effects for m in model.sensors.values()}:
        same = [s for s in SENSORS if s in model.sensors and model.sensors[s].effects == listed]
        if listed and not any(_shared(effect, runs[0], same) for effect in listed):
            refitted = _refit(listed, same, model, runs, recordings, truth or resting_conditions)
            sensors.update(refitted)
    notes = (*model.provenance.notes, 'coefficients per axis are fitted to single samples')
    return replace(model, sensors=sensors, provenance=replace(model.provenance, notes=notes))


def _shared(effect: Effect, run: PreparedRun, sensors: list[Sensor]) -> bool:
    """Tell whether axes share the effect's coefficients or its columns depend on the sensor."""
    few = run.conditions.rows(slice(0, 50))
    columns = [effect.columns(few.of(sensor))[0] for sensor in sensors]
    return columns[0].ndim == 3 or any(not np.array_equal(columns[0], c) for c in columns)


def _refit(
    effects: tuple[Effect, ...],
    sensors: list[Sensor],
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    recordings: Sequence[ImuRecording],
    truth: Truth,
) -> dict[str, SensorModel]:
    """Return sensors of one list of effects with coefficients from all samples."""
    equations: NormalEquations | None = None
    for recording in recordings:
        settled = cut_startup(recording)
        conditions = truth(settled)
        offset = (settled.stamp[0] - recording.stamp[0]) * 1e-9
        conditions = replace(conditions, time=conditions.time + offset)
        measured = [getattr(settled, SENSOR_FIELDS[sensor]) for sensor in sensors]
        part = gram(effects, conditions, measured).equations()
        equations = part if equations is None else equations + part
    assert equations is not None  # noqa: S101 (fit_prepared has refused an empty list)
    blocks = sum(len(run) for run in runs)
    refitted: dict[str, SensorModel] = {}
    for k, sensor in enumerate(sensors):
        before = model.sensors[sensor]
        by_blocks = ordinary(effects, sensor, before, runs)
        own = np.column_stack(
            [
                solve(
                    replace(
                        equations,
                        gram=equations.gram + np.diag(penalty) * (equations.rows / blocks),
                        moment=equations.moment[:, [3 * k + axis]],
                        energy=equations.energy[[3 * k + axis]],
                    )
                ).estimate
                for axis, penalty in enumerate(by_blocks.penalty)
            ]
        )
        widths = np.cumsum([c.shape[0] for c in before.coefficients])[:-1]
        refitted[sensor] = replace(
            before,
            coefficients=tuple(np.split(own, widths)),
            covariance=by_blocks.covariance(),
        )
    return refitted


@dataclass(frozen=True, eq=False)
class OrdinaryLeastSquares:
    """Least squares with priors that weights all block means alike, and its covariance."""

    normal: FloatArray
    """(p, p) XᵀX of columns about the mean of their run."""
    spread: FloatArray
    """(3, p, p) Xᵀ S X, S the covariance of the noise of each axis."""
    deviations: FloatArray
    """(p, 3) of the priors; infinite where a coefficient is free."""

    @property
    def penalty(self) -> FloatArray:
        """(3, p) what the priors add to the diagonal of XᵀX.

        It minimises the expected error of a single column.
        """
        variance = np.diagonal(self.spread, axis1=1, axis2=2)
        variance = variance / np.maximum(np.diag(self.normal), 1e-300)
        penalty: FloatArray = variance / self.deviations.T**2
        return penalty

    def covariance(self) -> FloatArray:
        """Return (3p, 3p) A⁻¹ (Xᵀ S X + P D P) A⁻¹, A = XᵀX + P, P the penalty, D the prior."""
        p = len(self.normal)
        covariance = np.zeros((p, 3, p, 3))
        for axis, penalty in enumerate(self.penalty):
            held = self.normal + np.diag(penalty)
            inverse, _ = pseudo_solve(held, np.eye(p))
            known = np.where(penalty > 0.0, self.deviations[:, axis], 0.0)
            middle = self.spread[axis] + np.diag((penalty * known) ** 2)
            covariance[:, axis, :, axis] = inverse @ middle @ inverse
        full: FloatArray = covariance.reshape(3 * p, 3 * p)
        return full


def ordinary(
    effects: Sequence[Effect], sensor: Sensor, model: SensorModel, runs: Sequence[PreparedRun]
) -> OrdinaryLeastSquares:
    """Return the ordinary least squares of one sensor under the fitted noise.

    It is that of block means, whose slow noise is the samples'.
    """
    assert model.noise is not None  # noqa: S101 (every fit has one)
    deviations = []
    for effect, coefficients in zip(effects, model.coefficients, strict=True):
        known = effect.coefficient_deviations()
        free = np.full(coefficients.shape, np.inf)
        deviations.append(free if known is None else np.maximum(known, LEAST_DEVIATION))
    p = sum(len(d) for d in deviations)
    normal, spread = np.zeros((p, p)), np.zeros((3, p, p))
    for run in runs:
        columns = np.concatenate([run.columns(e, sensor) for e in effects], axis=1)
        columns = columns - columns.mean(axis=0)
        normal += columns.T @ columns
        for axis in range(3):
            spread[axis] += columns.T @ noise_product(model.noise, run, axis, columns)
    return OrdinaryLeastSquares(normal, spread, np.concatenate(deviations))
