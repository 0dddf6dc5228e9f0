# SPDX-License-Identifier: Apache-2.0
"""What the reference contributes: gravity, its direction, the Earth's rotation, the field."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray
from thermal_comp.data.conditions import EARTH_RATE_RAD_S
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect

from imu_workbench.report.certificate.budget import Input, Uncounted
from imu_workbench.report.certificate.evidence import Evidence
from imu_workbench.report.certificate.joint_design import coefficient_columns, place_of

NEGLIGIBLE_SHARE = 1e-6
"""Share of the value below which what an error of the reference changes is rounding."""
TILT = 'reference: tilt'


def reference_of_bias(
    evidence: Evidence, axis: int
) -> tuple[list[int], dict[int, float], list[Input], list[Uncounted]]:
    """Return the runs that determine a bias, the true input in each, its inputs, what is missing.

    Gyroscope: at rest, the Earth's rotation within its bounds. Accelerometer: horizontal, where a
    run has the axis so, else gravity. Magnetometer: none, the field is not known to nanotesla.
    """
    everything = list(range(len(evidence.runs)))
    if evidence.sensor == 'gyroscope':
        earth = Input('reference: Earth rate', EARTH_RATE_RAD_S / math.sqrt(3.0), 'rad/s',
                      shape='rectangular')  # fmt: skip
        return everything, dict.fromkeys(everything, 0.0), [earth], []
    if evidence.sensor != 'accelerometer' or not all(evidence.up_axes):
        return [], {}, [], []
    gravity, spread, _ = evidence.laboratory.gravity
    level = [r for r, up in enumerate(evidence.up_axes) if up[1] != 'xyz'[axis]]
    if level:
        tilt = evidence.laboratory.tilt
        if tilt is None:
            return level, dict.fromkeys(level, 0.0), [], [Uncounted(TILT, 'not stated')]
        own = Input(TILT, gravity * math.sin(tilt) / math.sqrt(3.0), 'm/s²', shape='rectangular')
        return level, dict.fromkeys(level, 0.0), [own], []
    signs = {r: 1.0 if up[0] == '+' else -1.0 for r, up in enumerate(evidence.up_axes)}
    own = Input('reference: gravity', spread, 'm/s²')
    scale = Uncounted(
        'reference: scale factor at the reference temperature',
        'not told',
        'part of this bias, the axis stood upright',
    )
    return everything, {r: sign * gravity for r, sign in signs.items()}, [own], [scale]


def reference_of_unknown(
    evidence: Evidence, effect: Effect | None, unknown: int, value: float, unit: str
) -> tuple[list[Input], list[Uncounted]]:
    """Return what the reference contributes to an unknown of the joint design, what is missing.

    `effect` is the one whose coefficient it is; None for a shape parameter.
    """
    inputs: list[Input] = []
    missing: list[Uncounted] = []
    if effect is not None and scales_with(evidence, effect, 'specific_force'):
        gravity, spread, _ = evidence.laboratory.gravity
        off = relative(spread, gravity, _strength(evidence, _specific_force))
        inputs.append(Input('reference: gravity', off, '1', kind='input'))
    if evidence.sensor == 'magnetometer':
        if effect is not None and scales_with(evidence, effect, 'magnetic_field'):
            _put(_field(evidence), inputs, missing)
        _put(_variation(evidence, unknown, value, unit), inputs, missing)
    else:
        _put(_tilt(evidence, unknown, value, unit), inputs, missing)
    return inputs, missing


def _put(found: Input | Uncounted | None, inputs: list[Input], missing: list[Uncounted]) -> None:
    if isinstance(found, Uncounted):
        missing.append(found)
    elif found is not None:
        inputs.append(found)


def scales_with(evidence: Evidence, effect: Effect, channel: str) -> bool:
    """Tell whether the columns of an effect are proportional to a true input."""
    if not all(run.conditions.has(c) for run in evidence.runs for c in effect.needs):
        return False
    run = evidence.runs[0]
    twice = replace(
        run,
        conditions=replace(run.conditions, **{channel: 2.0 * getattr(run.conditions, channel)}),
    )
    before, after = (r.columns(effect, evidence.sensor) for r in (run, twice))
    return bool(before.any() and np.allclose(after, 2.0 * before, rtol=1e-9))


def relative(spread: float, stated: float, used: float) -> float:
    """Return the relative uncertainty of a true input that the fit took uncorrected.

    It is made of its standard uncertainty and the difference of the fit's value from the stated.
    """
    return math.hypot(spread, stated - used) / used


def _specific_force(run: PreparedRun) -> FloatArray:
    return run.conditions.specific_force


def _magnetic_field(run: PreparedRun) -> FloatArray:
    iron = run.conditions.hard_iron
    field = run.conditions.magnetic_field
    return field if iron is None else field - iron


def _strength(evidence: Evidence, of: Callable[[PreparedRun], FloatArray]) -> float:
    """Return the mean size of the true input that the fit was given, over the runs [SI]."""
    sizes = [float(np.linalg.norm(np.nanmean(of(run), axis=0))) for run in evidence.runs]
    return float(np.mean(sizes))


def _field(evidence: Evidence) -> Input | Uncounted:
    """Return the relative error of the field's strength."""
    used = _strength(evidence, _magnetic_field)
    stated = evidence.laboratory.field
    if stated is None:
        return Uncounted('reference: field', 'not stated')
    value, spread = stated
    return Input('reference: field', relative(spread, value or used, used), '1', kind='input')


def _variation(
    evidence: Evidence, unknown: int, value: float, unit: str
) -> Input | Uncounted | None:
    """Return the change of an unknown by a field that varies in step with temperature.

    At either end by the half-width, rectangular, in each run and axis with the sign that moves the
    unknown most. None where it does not act.
    """
    joint = evidence.joint
    ends = math.sqrt(2.0) * (joint.temperature - joint.temperature.mean()) / evidence.span
    moved = sum(
        abs(joint.response(_only(ends, joint.run == r, axis))[unknown])
        for r in range(len(evidence.runs))
        for axis in range(3)
    )
    half = evidence.laboratory.field_variation
    size = moved * (half or 1e-9) / math.sqrt(3.0)
    if size <= NEGLIGIBLE_SHARE * abs(value):
        return None
    if half is None:
        return Uncounted('reference: field variation', 'not stated')
    return Input('reference: field variation', float(size), unit, shape='rectangular')


def by_tilt(evidence: Evidence) -> FloatArray:
    """(3 r, q) change of the unknowns with gravity turned about each axis in each run [1/rad]."""
    joint, model, sensor = evidence.joint, evidence.model, evidence.sensor
    felt = [
        (effect, values)
        for effect, values in zip(model.effects, model.coefficients, strict=True)
        if scales_with(evidence, effect, 'specific_force')
    ]
    found = []
    for r, run in enumerate(evidence.runs if felt else ()):
        for axis in np.eye(3):
            force = np.cross(axis, run.conditions.specific_force)
            turned = replace(run, conditions=replace(run.conditions, specific_force=force))
            place = place_of(run, model)
            error = np.zeros_like(joint.residual)
            error[joint.run == r] = sum(
                coefficient_columns(turned, sensor, effect, values, place) @ values.ravel()
                for effect, values in felt
            )
            found.append(joint.response(error))
    return np.array(found).reshape(-1, joint.columns.shape[2])


def _only(values: FloatArray, rows: FloatArray, axis: int) -> FloatArray:
    """(n, 3) with the values in some rows of one axis, else zero."""
    found = np.zeros((len(values), 3))
    found[rows, axis] = values[rows]
    return found


def _tilt(evidence: Evidence, unknown: int, value: float, unit: str) -> Input | Uncounted | None:
    """Return the change of an unknown by an error of gravity's direction, runs independently.

    The modelled error changes with the specific force turned about each axis; rectangular.
    """
    half = evidence.laboratory.tilt
    moved = float(np.linalg.norm(by_tilt(evidence)[:, unknown]))
    if moved * (half or math.radians(1.0)) <= NEGLIGIBLE_SHARE * abs(value):
        return None
    if half is None:
        return Uncounted(TILT, 'not stated')
    return Input(TILT, moved * math.sin(half) / math.sqrt(3.0), unit, shape='rectangular')
