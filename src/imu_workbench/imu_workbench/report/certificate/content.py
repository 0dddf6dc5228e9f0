# SPDX-License-Identifier: Apache-2.0
"""Everything a calibration certificate says, as plain values; ISO/IEC 17025:2017, 7.8.

`doc/certificate.md` lists clause by clause where each requirement is met.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from imu_recording.recording import ImuRecording
from imu_recording.user_error import UserError
from thermal_comp.model.values import fitted_shapes
from thermal_comp.presentation.display import (
    DISPLAY_UNITS,
    SENSORS,
    fixed,
    shown,
)

from imu_workbench.report.analysis import Analysis, Certified
from imu_workbench.report.certificate.allan import (
    allan_content,
    allan_curves,
    allan_deviations,
    datasheet_noise,
    rows_note,
    without_density,
)
from imu_workbench.report.certificate.conclusion import conclusion
from imu_workbench.report.certificate.joint_design import shape_labels
from imu_workbench.report.certificate.quantities import Quantity, quantities
from imu_workbench.report.certificate.recordings import (
    conditions,
    losses,
    ramp_rate,
    recording_row,
)
from imu_workbench.report.laboratory import NOT_STATED, Laboratory
from imu_workbench.report.limits import CoefficientLimits
from imu_workbench.report.modelled import errors_of_run
from imu_workbench.report.series import line

SCHEMA = 2
"""Schema of a certificate's content: since 2 `shapes` have the form of `quantities`, a budget
each."""
RESIDUAL_POINTS = 600
"""Points of a residual's line on paper."""
RULES = {
    'guarded': 'guarded acceptance (ILAC-G8:09/2019): kept where the value is inside the limits '
    'by w, not kept where it is outside by w, else not decided; w is U, or k₉₅ · u where k₉₅ is '
    'above 2; the probability of a wrong statement is at most 2.5 %',
    'simple': 'simple acceptance (ILAC-G8:09/2019): the value alone decides; near a limit the '
    'probability of a wrong statement is up to 50 %',
}


def certificates(
    analysis: Analysis, laboratory: Laboratory, limits: CoefficientLimits | None
) -> dict[str, dict[str, Any]]:
    """Return the certificate of each device that has a model."""
    return {
        name: certificate(name, certified, analysis, laboratory, limits)
        for name, certified in analysis.certified.items()
    }


def certificate(
    device: str,
    certified: Certified,
    analysis: Analysis,
    laboratory: Laboratory,
    limits: CoefficientLimits | None,
) -> dict[str, Any]:
    """Return the content of the certificate of one device."""
    runs = [run for run in analysis.runs if run.device == device]
    recordings = [run.recording for run in runs]
    temperatures = _range(part.temperature_range for part in certified.model.sensors.values())
    every = all_quantities(certified, recordings, laboratory)
    results = result_content(certified, every)
    errors = error_content(certified)
    decisions = decision_content([q for q in every if not q.shape], limits)
    return {
        'schema': SCHEMA,
        'device': device_statements(device, laboratory),
        'simulated': laboratory.simulated or any(r.simulated for r in recordings),
        'laboratory': laboratory_statements(laboratory, recordings),
        'recordings': [recording_row(run.recording, run.hash) for run in runs],
        'losses': losses(recordings),
        'conditions': conditions(recordings, *temperatures),
        'equations': equations(certified),
        'method': method(
            certified, recordings, every, in_chamber=bool(laboratory.content.get('chamber'))
        ),
        'reference_temperature': certified.model.reference_temperature,
        **results,
        'errors': errors,
        'residuals': residuals(certified),
        **noise_content(certified, recordings, laboratory),
        'period': certified.comparison.period,
        'not_included': not_included(every),
        **decisions,
        'validity': validity(recordings, *temperatures),
        'monte_carlo_deviation': monte_carlo_deviation(every),
        'added': list(certified.added),
        'conclusion': conclusion(
            certified, results['shapes'], errors, decisions['decisions'],
            analysis.diagnoses.get(device), temperatures,
        ),
    }  # fmt: skip


def all_quantities(
    certified: Certified, recordings: Sequence[ImuRecording], laboratory: Laboratory
) -> list[Quantity]:
    """Return every coefficient and shape parameter that has an uncertainty."""
    up_axes = {recording.run: recording.up_axis for recording in recordings}
    up_axes_of_runs = [up_axes.get(run.name, '') for run in certified.runs]
    return quantities(certified.model, certified.runs, up_axes_of_runs, laboratory)


def device_statements(device: str, laboratory: Laboratory) -> dict[str, str]:
    """Return the device's name, and what the laboratory states about it."""
    stated = ('type', 'manufacturer', 'serial', 'condition')
    return {'name': device} | {key: laboratory.text('device', key) for key in stated}


def laboratory_statements(
    laboratory: Laboratory, recordings: Sequence[ImuRecording]
) -> dict[str, Any]:
    """Return what the laboratory states about itself, this calibration and its instruments."""
    of_itself = ('name', 'address', 'country', 'accreditation')
    of_the_work = ('received', 'place', 'operator', 'approved_by', 'traceability', 'deviations')
    return {
        **{key: laboratory.text('laboratory', key) for key in of_itself},
        'customer': _joined(laboratory.text('customer', key) for key in ('name', 'address')),
        'number': laboratory.text('certificate', 'number'),
        'date_of_issue': laboratory.text('certificate', 'date_of_issue'),
        **{key: laboratory.text(key) for key in of_the_work},
        'chamber': laboratory.instrument('chamber'),
        'thermometer': laboratory.instrument('thermometer'),
        'references': references(laboratory, recordings),
    }


def result_content(certified: Certified, every: Sequence[Quantity]) -> dict[str, Any]:
    """Return the coefficients, those that are missing, and the shape parameters."""
    coefficients = [q for q in every if not q.shape]
    shapes = [quantity_content(q) for q in every if q.shape]
    return {
        'quantities': [quantity_content(q) for q in coefficients],
        'not_determined': not_determined(coefficients, certified),
        'shapes': shapes + shapes_without_uncertainty(certified, every),
    }


def noise_content(
    certified: Certified, recordings: Sequence[ImuRecording], laboratory: Laboratory
) -> dict[str, Any]:
    """Return the noise of what the model leaves: its coefficients and its Allan deviation."""
    deviations = allan_deviations(certified.model, certified.runs)
    return {
        'allan': allan_content(deviations, datasheet_noise(laboratory)),
        'allan_rows': rows_note(recordings),
        'without_density': without_density(laboratory),
        'allan_deviation': allan_curves(deviations),
    }


def decision_content(
    coefficients: Sequence[Quantity], limits: CoefficientLimits | None
) -> dict[str, Any]:
    """Return the decisions on the limits, limits without a result, and the rule of decision."""
    decisions = decided(coefficients, limits)
    return {
        'decisions': decisions,
        'without_result': without_result(decisions, limits),
        'rule': RULES[limits.rule] if limits else '',
        'limits_source': limits.source if limits else '',
    }


def references(laboratory: Laboratory, recordings: Sequence[ImuRecording]) -> dict[str, str]:
    """Return the statements about the reference of each sensor; the gradient as in the budgets.

    A gradient that nobody stated is that of the thermocouple where one was logged.
    """
    stated = laboratory.references()
    logged = all(r.device_temperature is not None for r in recordings)
    if laboratory.gradient is None and logged:
        stated['gradient thermometer to die'] = 'by the thermocouple in the recordings'
    return stated


def method(
    certified: Certified,
    recordings: Sequence[ImuRecording],
    found: Sequence[Quantity],
    *,
    in_chamber: bool,
) -> list[str]:
    """Return the method in five sentences; a chamber is in it where recorded or stated."""
    count = len(recordings)
    period = shown(certified.comparison.period, 2)
    reference = fixed(certified.model.reference_temperature, 0)
    folds = certified.comparison.held_out
    planned = any(r.profile or r.setpoint is not None for r in recordings)
    in_chamber |= planned or any(r.chamber_temperature is not None for r in recordings)
    rested = (
        f'The device rested {"in a climatic chamber " * in_chamber}in {count} '
        f'run{"s" * (count > 1)}, while '
        f'{"the air was led through the plan" if planned else "its temperature changed"}; its '
        'outputs and its own thermometer were recorded together.'
    )
    averaged = (
        f'Outputs were averaged over {period} s, without the samples of the start-up and those '
        'where cycles meet; the error of each axis is written as level + slope · (T − T₀) + named '
        f'effects, T the device’s own temperature, smoothed, and T₀ = {reference} °C.'
    )
    fitted = (
        'Coefficients were found by generalised least squares under the coloured noise that the '
        'data show, shape parameters (time constants and the like) by search.'
    )
    judged = (
        f'Errors after compensation are of data the fit had not seen, {folds}; the noise floor is '
        'what noise alone would leave.'
    )
    propagated = (
        'Uncertainties follow the GUM (JCGM 100): U is k = 2 times the combined standard '
        'uncertainty, ν its effective degrees of freedom; a Monte Carlo propagation (JCGM 101) '
        f'differs by {percent_at_most(monte_carlo_deviation(found))} at most.'
    )
    return [rested, averaged, fitted, judged, propagated]


def equations(certified: Certified) -> dict[str, str]:
    """Return the equation of every effect beyond the line, which defines its symbols."""
    effects = [e for part in certified.model.sensors.values() for e in part.effects]
    return {
        effect.name: ' '.join(effect.equation.split())
        for effect in effects
        if not effect.temperature_coefficient
    }


def monte_carlo_deviation(found: Sequence[Quantity]) -> float:
    """Return the largest relative difference of Monte Carlo and GUM uncertainty."""
    ratios = [q.budget.monte_carlo / q.budget.combined for q in found if q.budget.combined > 0.0]
    return float(max((abs(ratio - 1.0) for ratio in ratios), default=0.0))


def percent_at_most(share: float) -> str:
    """Return a share in percent that is not below it, to a tenth.

    >>> percent_at_most(0.0106).split()
    ['1.1', '%']
    """
    return f'{math.ceil(1e3 * share - 1e-9) / 10.0:.1f}\u00a0%'


def quantity_content(quantity: Quantity) -> dict[str, Any]:
    """Return one coefficient with its budget."""
    return {
        'sensor': quantity.sensor,
        'axis': quantity.axis,
        'coefficient': quantity.coefficient,
        'detection_limit': quantity.detection_limit,
        **quantity.budget.to_dict(),
    }


def shapes_without_uncertainty(
    certified: Certified, found: Sequence[Quantity]
) -> list[dict[str, Any]]:
    """Return the shape parameters whose uncertainty the model does not have."""
    told = {(q.sensor, q.coefficient) for q in found}
    rows = []
    for shape in fitted_shapes(certified.model):
        values = shape['value'] if isinstance(shape['value'], list) else [shape['value']]
        labels = shape_labels(shape['effect'], shape['parameter'], len(values))
        for label, value in zip(labels, values, strict=True):
            if (shape['sensor'], label) not in told:
                rows.append(
                    {
                        'sensor': shape['sensor'],
                        'axis': 'all',
                        'coefficient': label,
                        'value': value,
                        'unit': shape['unit'],
                    }
                )
    return rows


def not_included(found: Sequence[Quantity]) -> list[str]:
    """Return what acts on some results and is not counted, with the results it acts on."""
    named: dict[str, dict[str, dict[str, None]]] = {}
    for quantity in found:
        name = re.split(', |: ', quantity.coefficient)[0].replace('_', ' ')
        for one in quantity.budget.uncounted:
            of_sensor = named.setdefault(str(one), {}).setdefault(quantity.sensor, {})
            of_sensor[name] = None
    return [
        f'{text} ({"; ".join(f"{s} {', '.join(names)}" for s, names in sensors.items())})'
        for text, sensors in sorted(named.items())
    ]


def not_determined(found: Sequence[Quantity], certified: Certified) -> list[str]:
    """Return which results are missing, and why."""
    result = []
    for sensor in certified.model.sensors:
        names = {q.coefficient for q in found if q.sensor == sensor}
        if not names:
            result.append(f'{sensor}: not measured in every run')
        elif 'bias' not in names:
            why = (
                'the field in the chamber is not known'
                if sensor == 'magnetometer'
                else 'the orientation of a run is not known'
            )
            result.append(f'bias of the {sensor}: {why}')
    return result


def error_content(certified: Certified) -> list[dict[str, Any]]:
    """Return rms errors before and after, with the noise floor, per axis [display unit]."""
    rows = []
    for sensor, part in certified.comparison.sensors.items():
        unit = DISPLAY_UNITS[sensor]
        for i, axis in enumerate('xyz'):
            before, after, floor = (
                float(values[i]) * unit.factor
                for values in (part.measured_rms, part.held_out_rms, part.noise_floor)
            )
            rows.append(
                {
                    'sensor': sensor,
                    'axis': axis,
                    'unit': unit.unit,
                    'before': before,
                    'after': after,
                    'floor': floor,
                    'ratio': after / floor if floor > 0.0 else math.nan,
                }
            )
    return rows


def residuals(certified: Certified) -> dict[str, dict[str, Any]]:
    """Return per run and sensor what the certified model leaves over time [display unit]."""
    result: dict[str, dict[str, Any]] = {}
    for run in certified.runs:
        errors = errors_of_run(run, certified.model)
        gap = 3.0 * run.period / 3600.0
        result[run.name] = {
            sensor: {
                'unit': DISPLAY_UNITS[sensor].unit,
                'floor': certified.comparison.sensors[sensor].noise_floor
                * DISPLAY_UNITS[sensor].factor,
                'axes': {
                    axis: line(
                        errors.time / 3600.0,
                        DISPLAY_UNITS[sensor].of(errors.residual(sensor)[:, i]),
                        points=RESIDUAL_POINTS,
                        max_gap=gap,
                    )
                    for i, axis in enumerate('xyz')
                },
            }
            for sensor in SENSORS
            if sensor in errors.measured and sensor in certified.comparison.sensors
        }
    return result


def decided(found: Sequence[Quantity], limits: CoefficientLimits | None) -> list[dict[str, Any]]:
    """Return the decision on every coefficient that has a limit."""
    rows = []
    for quantity in found if limits else ():
        assert limits is not None  # noqa: S101 (the loop is empty without)
        name = quantity.coefficient.partition(', ')[0]
        limit = limits.of(quantity.sensor, name)
        if limit is None:
            continue
        if limit.unit != quantity.budget.unit:
            raise UserError(
                f'limits: {quantity.sensor}.{name} is in {limit.unit}, its coefficient in '
                f'{quantity.budget.unit}'
            )
        width = quantity.budget.deciding
        decision = limit.decide(quantity.budget.value, width, limits.rule)
        rows.append(
            {
                'sensor': quantity.sensor,
                'axis': quantity.axis,
                'coefficient': quantity.coefficient,
                'lower': limit.lower,
                'upper': limit.upper,
                'unit': limit.unit,
                'decision': decision,
                'deciding': width if limits.rule == 'guarded' else None,
            }
        )
    return rows


def without_result(
    decisions: Sequence[Mapping[str, Any]], limits: CoefficientLimits | None
) -> list[str]:
    """Return the limits of coefficients that were not determined."""
    told = {(d['sensor'], d['coefficient'].partition(', ')[0]) for d in decisions}
    given = limits.sensors.items() if limits else ()
    return [
        f'{name} of the {sensor}'
        for sensor, named in given
        for name in named
        if (sensor, name) not in told
    ]


def validity(recordings: Sequence[ImuRecording], low: float, high: float) -> str:
    """Return where and when the results hold."""
    rates = [rate for r in recordings if (rate := ramp_rate(r)) is not None]
    change = f', changing by at most {shown(max(rates), 2)} K/min' if rates else ''
    return (
        f'The results hold for the device as recorded, between {fixed(low, 1)} and '
        f'{fixed(high, 1)} °C of its own thermometer{change}; drift after the recordings is not '
        'part of the uncertainty, and no interval of recalibration is recommended.'
    )


def _range(ranges: Iterable[tuple[float, float]]) -> tuple[float, float]:
    lows, highs = zip(*ranges, strict=True)
    return float(min(lows)), float(max(highs))


def _joined(texts: Iterable[str]) -> str:
    return ', '.join(text for text in texts if text != NOT_STATED) or NOT_STATED
