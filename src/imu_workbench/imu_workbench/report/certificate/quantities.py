# SPDX-License-Identifier: Apache-2.0
"""The coefficients a certificate states: bias, slope and named effects per axis, each budgeted."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import PHASES, SENSOR_UNITS, FloatArray, IntArray
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.model.values import ThermalModel

from imu_workbench.report.certificate.budget import (
    Budget,
    Input,
    Kind,
    Measurand,
    Uncounted,
    budget_of,
    scatter_inputs,
)
from imu_workbench.report.certificate.evidence import Evidence
from imu_workbench.report.certificate.joint_design import JointDesign
from imu_workbench.report.certificate.references import reference_of_bias, reference_of_unknown
from imu_workbench.report.certificate.replicates import replicates
from imu_workbench.report.laboratory import Laboratory

END_SHARE = 0.1
"""Share of the temperature range at each end that counts as its end."""
NEAR_REFERENCE_K = 2.5
"""Blocks within this of the reference temperature show how far the model is off there [K]."""


@dataclass(frozen=True)
class Quantity:
    """One coefficient of one axis."""

    sensor: Sensor
    axis: str
    coefficient: str
    """`bias`, `slope`, or the name of an effect, with the symbol of its column where several; of a
    shape parameter the effect's and its own name, `thermal_lag: time_constant`."""
    budget: Budget
    detection_limit: float = math.nan
    """Smallest true value told from zero with 5 % of errors of both kinds (ISO 11843-1)."""

    @property
    def shape(self) -> bool:
        """Whether it is a shape parameter: a time constant, a width."""
        return ': ' in self.coefficient


def quantities(
    model: ThermalModel,
    runs: Sequence[PreparedRun],
    up_axes: Sequence[str],
    laboratory: Laboratory,
) -> list[Quantity]:
    """Return every coefficient of the device effects of a model and every shape parameter.

    `up_axes` are those of the runs, '' where not known.
    """
    found: list[Quantity] = []
    for sensor, part in model.sensors.items():
        name: Sensor = sensor  # type: ignore[assignment]
        seen = [run for run in runs if np.isfinite(run.measured[name]).any()]
        if len(seen) < len(runs):
            continue
        low, high = part.temperature_range
        evidence = Evidence(
            sensor=name,
            model=part,
            runs=tuple(runs),
            up_axes=tuple(up_axes),
            repeated=replicates(part, runs, name),
            joint=JointDesign.of(part, runs, name),
            laboratory=laboratory,
            span=high - low,
            gradient=dwell_gradient(runs),
            reference_temperature=model.reference_temperature,
        )
        fitted = [*coefficients_of(evidence), *shapes_of(evidence)]
        found += [*biases(evidence), *(budgeted(evidence, one) for one in fitted)]
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
        used, reference, inputs, missing = reference_of_bias(evidence, axis)
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
        yield Quantity(evidence.sensor, 'xyz'[axis], 'bias', budget)


def temperature_inputs(evidence: Evidence, *, span: bool) -> tuple[list[Input], list[Uncounted]]:
    """Return what thermometer and gradient contribute, and what is not known of them.

    `span`: to the difference between the ends of the range, else to every temperature.
    """
    kind: Kind = 'span' if span else 'temperature'
    factor = math.sqrt(2.0) if span else 1.0
    inputs: list[Input] = []
    missing: list[Uncounted] = []
    calibration = evidence.laboratory.standard_uncertainty('thermometer')
    if calibration is None:
        missing.append(Uncounted('thermometer calibration', 'not stated'))
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
        missing.append(
            Uncounted('gradient thermometer to die', 'not stated', 'no thermocouple was logged')
        )
        return inputs, missing
    inputs.append(
        Input('gradient thermometer to die', spread, 'K', degrees, kind=kind,
              shape='normal' if span and half is None else 'rectangular')
    )  # fmt: skip
    return inputs, missing


@dataclass(frozen=True, eq=False)
class Fitted:
    """A coefficient of an axis, or a shape parameter, as it was fitted."""

    name: str
    axis: str
    """`all` where the axes share it."""
    unit: str
    value: float
    noise: float
    """Standard uncertainty of the fit [unit]."""
    noise_degrees: float
    unknown: int
    """Its place in the joint design."""
    effect: Effect | None
    """Effect whose coefficient it is; None for a shape parameter."""
    changes: FloatArray
    """(k,) changes from its value to those of single parts [unit]."""
    run: IntArray
    """(k,) number of the run of each part."""
    form: float | None
    """Standard uncertainty of the model's form, None where not told [unit]."""


def coefficients_of(evidence: Evidence) -> Iterator[Fitted]:
    """Give every coefficient of the device effects, axis by axis; shared ones once."""
    deviation = np.sqrt(np.maximum(np.diag(evidence.model.covariance), 0.0))
    stop = 0
    for i, (effect, values) in enumerate(
        zip(evidence.model.effects, evidence.model.coefficients, strict=True)
    ):
        start, stop = stop, stop + values.size
        unknowns = np.arange(start, stop).reshape(values.shape)
        if effect.kind != 'device' or effect.per_run:
            continue
        shared = values.ndim == 1
        linear = effect.temperature_coefficient
        units = effect.units_of_coefficients(len(values), SENSOR_UNITS[evidence.sensor])
        for column, label in enumerate(effect.coefficient_labels(len(values))):
            repeated = None if shared else evidence.repeated.of(i, column)
            for axis in range(1 if shared else 3):
                place = (column,) if shared else (column, axis)
                unknown, value = int(unknowns[place]), float(values[place])
                if repeated is None:
                    changes, run = evidence.joint.scatter_of(unknown)
                else:
                    changes, run = repeated[:, axis] - value, evidence.repeated.run
                yield Fitted(
                    name='slope' if linear else label,
                    axis='all' if shared else 'xyz'[axis],
                    unit=units[column],
                    value=value,
                    noise=float(deviation[unknown]),
                    noise_degrees=evidence.noise_degrees(axis),
                    unknown=unknown,
                    effect=effect,
                    changes=changes,
                    run=run,
                    form=chord(evidence, axis) if linear else parts_differ(changes),
                )


def shapes_of(evidence: Evidence) -> Iterator[Fitted]:
    """Give every shape parameter of the model."""
    degrees = min(evidence.noise_degrees(axis) for axis in range(3))
    for k, shape in enumerate(evidence.joint.shapes):
        unknown = evidence.joint.coefficients + k
        changes, run = evidence.joint.scatter_of(unknown)
        told = parts_differ(changes)
        form = max(told or 0.0, shape.form) if told is not None or shape.form else None
        yield Fitted(
            name=shape.label,
            axis='all',
            unit=shape.unit,
            value=shape.value,
            noise=shape.std,
            noise_degrees=degrees,
            unknown=unknown,
            effect=None,
            changes=changes,
            run=run,
            form=form,
        )


def budgeted(evidence: Evidence, fitted: Fitted) -> Quantity:
    """Return a coefficient or shape parameter with its budget.

    A unit with a power of kelvin makes it sensitive to the thermometer's scale, a temperature to
    its offset; times and rates are sensitive to neither.
    """
    unit = fitted.unit
    scatter, untold = scatter_inputs(
        fitted.noise, fitted.noise_degrees, fitted.changes, fitted.run, unit,
        evidence.repeated.parts,
    )  # fmt: skip
    power, level = power_of_kelvin(unit), unit == '°C'
    warmth, unknown = temperature_inputs(evidence, span=not level) if power or level else ([], [])
    reference, unstated = reference_of_unknown(
        evidence, fitted.effect, fitted.unknown, fitted.value, unit
    )
    form = Input('model form', fitted.form or 0.0, unit, shape='rectangular')
    unseen = Uncounted('model form', 'not told', 'fewer than two parts of the runs tell it')
    told = fitted.form is not None
    budget = budget_of(
        Measurand(fitted.value, float(level), evidence.span, power),
        unit,
        [*warmth, *reference, *scatter, *([form] if told else [])],
        [*unknown, *unstated, *untold, *([] if told else [unseen])],
    )
    random = math.sqrt(sum(item.uncertainty**2 for item in scatter))
    return Quantity(
        sensor=evidence.sensor,
        axis=fitted.axis,
        coefficient=fitted.name,
        budget=budget,
        detection_limit=3.29 * random,
    )


def parts_differ(changes: FloatArray) -> float | None:
    """Return the standard uncertainty of the form from values of single parts minus the fitted.

    The mean of the parts' values, weighted equally, minus the value of all data, weighted by
    noise, is noise alone where the form is right (Hausman, 1978). It counts beyond the
    scatter of that mean, as a rectangular half-width; None where fewer than two parts tell it.
    """
    if len(changes) < 2:
        return None
    scatter = float(np.var(changes, ddof=1)) / len(changes)
    return math.sqrt(max(0.0, float(changes.mean()) ** 2 - scatter) / 3.0)


def power_of_kelvin(unit: str) -> int:
    """Return the power of 1/K in a unit.

    >>> power_of_kelvin('m/s²/K'), power_of_kelvin('rad/s/K²'), power_of_kelvin('T')
    (1, 2, 0)
    >>> power_of_kelvin('rad/s/(K·m/s²)'), power_of_kelvin('K')
    (1, -1)
    """
    found = re.search(r'/\(?K([²³]?)', unit)
    if found is None:
        return -1 if unit == 'K' else 0
    return {'': 1, '²': 2, '³': 3}[found[1]]


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
    """Return die temperature and what all effects leave (n,), of all runs together."""
    residual = evidence.joint.residual[:, axis]
    good = np.isfinite(residual)
    return evidence.joint.temperature[good], residual[good]
