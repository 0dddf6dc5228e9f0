# SPDX-License-Identifier: Apache-2.0
"""The coefficients a certificate states: bias, slope and named effects per axis, each budgeted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import PHASES, SENSOR_UNITS, FloatArray
from thermal_comp.data.conditions import EARTH_RATE, Sensor
from thermal_comp.data.preparation import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.model.values import SensorModel, ThermalModel
from thermal_comp.noise.process import mean_autocovariance

from imu_workbench.report.certificate.budget import (
    Budget,
    Input,
    Kind,
    Measurand,
    budget_of,
    scatter_inputs,
)
from imu_workbench.report.certificate.replicates import Replicates, replicates
from imu_workbench.report.laboratory import Laboratory
from imu_workbench.report.modelled import RunErrors, errors_of_run

END_SHARE = 0.1
"""Share of the temperature range at each end that counts as its end."""
NEAR_REFERENCE_K = 2.5
"""Blocks so near the reference temperature tell how well the model's level stands there [K]."""
AXES = 'xyz'


@dataclass(frozen=True)
class Quantity:
    """One coefficient of one axis."""

    sensor: Sensor
    axis: str
    coefficient: str
    """`bias`, `slope`, or the name of an effect, with the symbol of its column where several."""
    budget: Budget
    detection_limit: float = math.nan
    """Smallest true value told from zero with 5 % of errors of both kinds (ISO 11843-1)."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What the budgets of one sensor are computed from."""

    sensor: Sensor
    model: SensorModel
    runs: tuple[PreparedRun, ...]
    up_axes: tuple[str, ...]
    """Of each run; '' unknown."""
    repeated: Replicates
    errors: tuple[RunErrors, ...]
    laboratory: Laboratory
    span: float
    """Range of die temperature [K]."""
    gradient: FloatArray | None
    """Thermocouple minus die temperature of each dwell [K]; None: no thermocouple was logged."""
    reference_temperature: float

    @property
    def slope(self) -> FloatArray:
        """(3,) slope of the bias over temperature, zero where the model has none."""
        for effect, coefficients in zip(self.model.effects, self.model.coefficients, strict=True):
            if isinstance(effect, BiasTemperature):
                return np.asarray(coefficients[0])
        return np.zeros(3)

    def noise_degrees(self, axis: int) -> float:
        """Return the degrees of freedom of the noise's variance: n / Σ ρ² less one (Bartlett)."""
        assert self.model.noise is not None  # noqa: S101 (every fit has one)
        degrees = 0.0
        for run in self.runs:
            covariance = mean_autocovariance(self.model.noise, axis, run.period, len(run))
            rho = covariance / covariance[0] if covariance[0] > 0.0 else np.eye(1, len(run))[0]
            degrees += len(run) / (2.0 * float((rho**2).sum()) - 1.0)
        return max(1.0, degrees - 1.0)


def quantities(
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    up_axes: Sequence[str],
    laboratory: Laboratory,
) -> list[Quantity]:
    """Return every coefficient of the device effects of a model, with its budget.

    `up_axes` are those of the runs, '' where not known.
    """
    found: list[Quantity] = []
    errors = tuple(errors_of_run(run, model) for run in runs)
    for sensor, part in model.sensors.items():
        name: Sensor = sensor  # type: ignore[assignment]
        seen = [run for run in runs if np.isfinite(run.measured[name]).any()]
        if len(seen) < len(runs):
            continue
        low, high = part.temperature_range
        evidence = Evidence(
            name,
            part,
            tuple(runs),
            tuple(up_axes),
            replicates(part, runs, name),
            errors,
            laboratory,
            high - low,
            dwell_gradient(runs),
            model.reference_temperature,
        )
        found += [*biases(evidence), *coefficients_of(evidence)]
    return found


def dwell_gradient(runs: Sequence[PreparedRun]) -> FloatArray | None:
    """(d,) thermocouple minus die temperature, mean of each dwell of each cycle and run [K]."""
    dwells = [PHASES.index(p) for p in PHASES if p.startswith('dwell')]
    found = []
    for run in runs:
        track = run.conditions.device_temperature
        if track is None or not np.isfinite(track).any():
            return None
        difference = run.block_mean(track) - run.temperature
        for phase in dwells:
            for cycle in np.unique(run.cycle):
                rows = (run.phase == phase) & (run.cycle == cycle)
                if rows.sum() > 3:
                    settled = difference[rows][rows.sum() // 2 :]
                    found.append(float(settled.mean()))
    return np.array(found) if len(found) > 1 else None


def biases(evidence: Evidence) -> Iterator[Quantity]:
    """Give the bias at the reference temperature of each axis whose true input is known."""
    unit = SENSOR_UNITS[evidence.sensor]
    for axis in range(3):
        used, reference, inputs, missing = reference_input(evidence, axis)
        if not used:
            continue
        repeated = evidence.repeated
        here = np.isin(repeated.run, used)
        levels = [evidence.model.levels.get(evidence.runs[r].name) for r in used]
        known = [
            level[axis] - reference[r]
            for r, level in zip(used, levels, strict=True)
            if level is not None
        ]
        if not known:
            continue
        assert evidence.model.noise is not None  # noqa: S101 (every fit has one)
        variance = [
            evidence.model.noise.variance_of_means(len(evidence.runs[r]) * evidence.runs[r].period)
            for r in used
        ]
        noise = math.sqrt(sum(v[axis] for v in variance)) / len(used)
        offsets = np.array([reference[r] for r in repeated.run[here]])
        scatter, untold = scatter_inputs(
            noise,
            evidence.noise_degrees(axis),
            repeated.level[here, axis] - offsets,
            repeated.run[here],
            unit,
            repeated.parts,
        )
        slope = float(evidence.slope[axis])
        warmth, unknown = temperature_inputs(evidence, span=False)
        form = Input('model form', at_reference(evidence, axis), unit, shape='rectangular')
        budget = budget_of(
            Measurand(float(np.mean(known)), slope),
            unit,
            [*warmth, *inputs, *scatter, form],
            [*unknown, *missing, *untold],
        )
        yield Quantity(evidence.sensor, AXES[axis], 'bias', budget)


def reference_input(
    evidence: Evidence, axis: int
) -> tuple[list[int], dict[int, float], list[Input], list[str]]:
    """Return the runs that tell a bias, the true input in each, its inputs, what is missing.

    Gyroscope: at rest, the Earth's rotation within its bounds. Accelerometer: horizontal, where a
    run has the axis so, else gravity. Magnetometer: none, the field is not known to nanotesla.
    """
    everything = list(range(len(evidence.runs)))
    if evidence.sensor == 'gyroscope':
        earth = Input('Earth rate', EARTH_RATE / math.sqrt(3.0), 'rad/s', shape='rectangular')
        return everything, dict.fromkeys(everything, 0.0), [earth], []
    if evidence.sensor != 'accelerometer' or not all(evidence.up_axes):
        return [], {}, [], []
    gravity, spread, _ = evidence.laboratory.gravity
    level = [r for r, up in enumerate(evidence.up_axes) if up[1] != AXES[axis]]
    if level:
        tilt = evidence.laboratory.tilt
        if tilt is None:
            return level, dict.fromkeys(level, 0.0), [], ['tilt of the mounting: not stated']
        own = Input('reference: tilt', gravity * math.sin(tilt) / math.sqrt(3.0), 'm/s²',
                    shape='rectangular')  # fmt: skip
        return level, dict.fromkeys(level, 0.0), [own], []
    signs = {r: 1.0 if up[0] == '+' else -1.0 for r, up in enumerate(evidence.up_axes)}
    own = Input('reference: gravity', spread, 'm/s²')
    scale = 'scale factor at the reference temperature: part of this bias, the axis stood upright'
    return everything, {r: sign * gravity for r, sign in signs.items()}, [own], [scale]


def temperature_inputs(evidence: Evidence, *, span: bool) -> tuple[list[Input], list[str]]:
    """Return what thermometer and gradient contribute, and what is not known of them.

    `span`: to the difference between the ends of the range, else to every temperature.
    """
    kind: Kind = 'span' if span else 'temperature'
    factor = math.sqrt(2.0) if span else 1.0
    inputs, missing = [], []
    calibration = evidence.laboratory.standard_uncertainty('thermometer')
    if calibration is None:
        missing.append('thermometer calibration: not stated')
    else:
        inputs.append(Input('thermometer calibration', factor * calibration, 'K', kind=kind))
    gradient, half = evidence.gradient, evidence.laboratory.gradient
    if half is not None:
        spread, degrees = half / math.sqrt(3.0), math.inf
    elif gradient is not None:
        # The die's own thermometer against the thermocouple: its scatter over dwells is what
        # makes ends differ, its mean what every temperature may be off by.
        size = np.std(gradient, ddof=1) if span else np.hypot(np.mean(gradient), np.std(gradient))
        spread, degrees = float(size), math.inf if not span else float(len(gradient) - 1)
        spread = spread if span else spread / math.sqrt(3.0)
    else:
        missing.append('gradient thermometer to die: no thermocouple logged, nothing stated')
        return inputs, missing
    inputs.append(
        Input('gradient thermometer to die', spread, 'K', degrees, kind=kind,
              shape='normal' if span and half is None else 'rectangular')
    )  # fmt: skip
    return inputs, missing


def coefficients_of(evidence: Evidence) -> Iterator[Quantity]:
    """Give every coefficient of the device effects, axis by axis; shared ones once."""
    start = 0
    for i, (effect, values) in enumerate(
        zip(evidence.model.effects, evidence.model.coefficients, strict=True)
    ):
        size = values.size
        variance = np.diag(evidence.model.covariance)[start : start + size].reshape(values.shape)
        start += size
        if effect.kind != 'device' or effect.per_run:
            continue
        shared = values.ndim == 1
        for column, label in enumerate(effect.coefficient_labels(len(values))):
            units = effect.coefficient_units
            unit = (units[column] if column < len(units) else '').format(
                unit=SENSOR_UNITS[evidence.sensor]
            )
            linear = isinstance(effect, BiasTemperature)
            name = 'slope' if linear else label
            for axis in range(1 if shared else 3):
                place = (column,) if shared else (column, axis)
                fitted = Fitted(
                    name,
                    unit,
                    float(values[place]),
                    math.sqrt(max(0.0, float(variance[place]))),
                    None if shared else evidence.repeated.of(i, column),
                )
                yield _coefficient(evidence, fitted, axis, shared=shared, linear=linear)


@dataclass(frozen=True, eq=False)
class Fitted:
    """One coefficient of one axis as it was fitted."""

    name: str
    unit: str
    value: float
    noise: float
    """Standard uncertainty of the fit [unit]."""
    repeated: FloatArray | None
    """(k, 3) from single parts, of all axes."""


def _coefficient(
    evidence: Evidence, fitted: Fitted, axis: int, *, shared: bool, linear: bool
) -> Quantity:
    degrees, unit = evidence.noise_degrees(axis), fitted.unit
    if fitted.repeated is None:
        scatter = [Input('noise', fitted.noise, unit, degrees)]
        untold = ['repeatability and run to run of coefficients that no part of a run tells alone']
    else:
        values = fitted.repeated[:, axis]
        scatter, untold = scatter_inputs(
            fitted.noise, degrees, values, evidence.repeated.run, unit, evidence.repeated.parts
        )
    power = power_of_kelvin(unit)
    warmth, unknown = temperature_inputs(evidence, span=True) if power else ([], [])
    others, unstated = line_inputs(evidence, axis, unit) if linear else ([], [])
    budget = budget_of(
        Measurand(fitted.value, span=evidence.span, power=power),
        unit,
        [*warmth, *others, *scatter],
        [*unknown, *unstated, *untold],
    )
    random = math.sqrt(sum(item.uncertainty**2 for item in scatter))
    label = 'all' if shared else AXES[axis]
    return Quantity(evidence.sensor, label, fitted.name, budget, 3.29 * random)


def line_inputs(evidence: Evidence, axis: int, unit: str) -> tuple[list[Input], list[str]]:
    """Return what form and reference contribute to a slope, and what is not known of them."""
    inputs = [Input('model form', chord(evidence, axis), unit, shape='rectangular')]
    if evidence.sensor != 'magnetometer':
        return inputs, []
    variation = evidence.laboratory.field_variation
    if variation is None:
        return inputs, ['variation of the field: not stated']
    size = variation / math.sqrt(3.0) * math.sqrt(2.0) / evidence.span
    return [*inputs, Input('reference: field', size, unit, shape='rectangular')], []


def power_of_kelvin(unit: str) -> int:
    """Return the power of 1/K in a unit.

    >>> power_of_kelvin('m/s²/K'), power_of_kelvin('rad/s/K²'), power_of_kelvin('T')
    (1, 2, 0)
    """
    rest = unit.rpartition('/')[2]
    return {'K': 1, 'K²': 2, 'K³': 3}.get(rest, 0)


def chord(evidence: Evidence, axis: int) -> float:
    """Return the standard uncertainty of a slope from what the model leaves between the ends.

    The residual's difference between the hot and the cold end over their distance is the most a
    slope over the whole range may be off by; rectangular.
    """
    temperature, residual = pooled_residual(evidence, axis)
    low, high = temperature.min(), temperature.max()
    edge = END_SHARE * (high - low)
    cold, hot = temperature <= low + edge, temperature >= high - edge
    distance = temperature[hot].mean() - temperature[cold].mean()
    if not distance > 0.0:
        return 0.0
    return abs(float(residual[hot].mean() - residual[cold].mean()) / distance) / math.sqrt(3.0)


def at_reference(evidence: Evidence, axis: int) -> float:
    """Return the same for a bias: the mean residual near the reference temperature."""
    temperature, residual = pooled_residual(evidence, axis)
    near = np.abs(temperature - evidence.reference_temperature) <= NEAR_REFERENCE_K
    return abs(float(residual[near].mean())) / math.sqrt(3.0) if near.any() else 0.0


def pooled_residual(evidence: Evidence, axis: int) -> tuple[FloatArray, FloatArray]:
    """Return die temperature and residual (n,) of all runs together."""
    temperature = np.concatenate([run.temperature for run in evidence.errors])
    residual = np.concatenate([run.residual(evidence.sensor)[:, axis] for run in evidence.errors])
    good = np.isfinite(residual)
    return temperature[good], residual[good]
