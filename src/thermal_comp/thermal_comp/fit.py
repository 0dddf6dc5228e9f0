# SPDX-License-Identifier: Apache-2.0
"""Fit a thermal model: generalised least squares with the noise the data themselves show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np
from imu_recording.recording import FloatArray, ImuRecording

from thermal_comp.conditions import SENSORS, Sensor
from thermal_comp.effects.effect import Effect
from thermal_comp.fit_design import Design, Term
from thermal_comp.fit_shapes import ShapeDirection, refine_shapes, with_shape_directions
from thermal_comp.fit_solution import Solution, solve
from thermal_comp.model import ModelError, NoiseModel, Provenance, SensorModel, ThermalModel
from thermal_comp.noise import fit_noise
from thermal_comp.preparation import PERIOD, Truth, prepare
from thermal_comp.prepared_run import PreparedRun

Effects = Sequence[Effect] | Mapping[Sensor, Sequence[Effect]]
"""One list for all sensors (each takes those that can act on it), or one per sensor."""

SMALLEST_SPAN = 2.0
"""Least span of die temperature [K] a model can be fitted to."""


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
    noise = {s: known[s] if s in known else fit_noise(runs, s) for s in sensors}
    models: dict[Sensor, SensorModel] = {}
    for group in sensor_groups(listed):
        design = Design(runs, {s: listed[s] for s in group}, noise)
        if refine:
            design = refine_shapes(design)
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
                std = float(np.sqrt(variance * self._misfit()))
                found[name] = (*found.get(name, ()), std)
        return found


def fitted_group(design: Design) -> FittedGroup:
    """Return the solution of a design whose shape parameters stand."""
    solution = solve(design.equations())
    with_shapes = with_shape_directions(design, solution.estimate[:, 0])
    shaped = len(with_shapes.terms) > len(design.terms)
    shape_solution = solve(with_shapes.equations()) if shaped else solution
    return FittedGroup(design, solution, with_shapes, shape_solution, held_notes(design, solution))


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


def device_of(runs: Sequence[PreparedRun], *, pooled: bool = False) -> str:
    """Return the device of the runs; refuse none, mixed devices, and one run given twice."""
    if not runs:
        raise ModelError('no recordings given; a fit needs at least one run')
    seen: dict[str, str] = {}
    for run in runs:
        if run.hash in seen:
            raise ModelError(f'runs {seen[run.hash]} and {run.name} hold the same data')
        seen[run.hash] = run.name
    devices = sorted({run.device for run in runs})
    if len(devices) > 1 and not pooled:
        names = ', '.join(device or '(not named)' for device in devices)
        raise ModelError(
            f'the recordings are of several devices: {names}; '
            'fit each by itself, or all together with --pooled'
        )
    return '+'.join(devices)


def check_temperature(runs: Sequence[PreparedRun]) -> tuple[float, float]:
    """Return the range of die temperature [°C]; refuse one that shows no dependence."""
    low = min(float(run.conditions.temperature.min()) for run in runs)
    high = max(float(run.conditions.temperature.max()) for run in runs)
    if high - low < SMALLEST_SPAN:
        raise ModelError(
            f'the die temperature stays within {low:.2f} … {high:.2f} °C; '
            f'a thermal model needs a span of at least {SMALLEST_SPAN:g} K'
        )
    return low, high


def usable_sensors(runs: Sequence[PreparedRun]) -> tuple[list[Sensor], list[str]]:
    """Return the sensors that every run has measured, and why others are left out."""
    sensors: list[Sensor] = []
    notes = []
    for sensor in SENSORS:
        reason = next(filter(None, (_unusable(run, sensor) for run in runs)), '')
        if reason:
            notes.append(f'{sensor} left out: {reason}')
        else:
            sensors.append(sensor)
    if not sensors:
        raise ModelError('; '.join(notes))
    return sensors, notes


def _unusable(run: PreparedRun, sensor: Sensor) -> str:
    values = run.measured[sensor]
    values = values[np.isfinite(values).all(axis=1)]
    if len(values) < 2 * len(values.T):
        return f'run {run.name} has {len(values)} blocks of it'
    constant = [
        axis for axis, spread in zip('xyz', np.ptp(values, axis=0), strict=True) if not spread
    ]
    return f'run {run.name} {"".join(constant)} never changes' if constant else ''


def effects_by_sensor(
    effects: Effects, sensors: Sequence[Sensor], runs: Sequence[PreparedRun]
) -> dict[Sensor, tuple[Effect, ...]]:
    """Return the effects of each sensor, checked: known channels, none twice, sensor allowed."""
    listed: dict[Sensor, tuple[Effect, ...]] = {}
    for sensor in sensors:
        if isinstance(effects, Mapping):
            chosen = tuple(effects.get(sensor, ()))
        else:
            chosen = tuple(e for e in effects if sensor in e.sensors)
        names = [e.name for e in chosen]
        for effect in chosen:
            if sensor not in effect.sensors:
                raise ModelError(
                    f'{effect.name} does not act on the {sensor}, only on '
                    f'{", ".join(effect.sensors)}'
                )
            if names.count(effect.name) > 1:
                raise ModelError(f'{effect.name} is listed twice for the {sensor}')
            for run in runs:
                missing = [c for c in effect.channels if not run.conditions.has(c)]
                if missing:
                    raise ModelError(
                        f'{effect.name} needs {missing[0]}, which run {run.name} has not '
                        'logged; leave the effect out'
                    )
        listed[sensor] = chosen
    return listed


def sensor_groups(listed: Mapping[Sensor, tuple[Effect, ...]]) -> list[tuple[Sensor, ...]]:
    """Return the sensors in groups that share the coefficients of a coupled effect."""
    groups: list[tuple[Sensor, ...]] = []
    for sensor, effects in listed.items():
        coupled = {e for e in effects if e.coupled}
        joined = [g for g in groups if coupled & {e for s in g for e in listed[s]}]
        merged = (*(s for g in joined for s in g), sensor)
        groups = [g for g in groups if g not in joined] + [merged]
    return groups


def package_version() -> str:
    """Return the version of this package; '' where it is run from a bare tree."""
    try:
        return version('thermal_comp')
    except PackageNotFoundError:
        return ''
