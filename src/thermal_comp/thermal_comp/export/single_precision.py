# SPDX-License-Identifier: Apache-2.0
"""The rounding error of a model's C form in single precision, from the size of its terms.

A sum is rounded in proportion to its largest terms: where large terms nearly cancel, as those of
effects that look alike do, their sum is mostly rounding.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.compensation.recording import plan_of, sensor_error
from thermal_comp.data.conditions import SENSORS, Conditions, Sensor
from thermal_comp.effects.c_form import CForm, Signals
from thermal_comp.effects.effect import Effect, columns_from
from thermal_comp.model.values import SensorModel, ThermalModel

ROUNDING_PER_TERM = 2.0 * 2.0**-24
"""Error of a term, as a share of its size: two roundings, as measured (test_c99.py)."""
LARGEST_ROUNDING_SHARE = 1e-5
"""Share of the correction's range that single precision may be off by."""


def single_precision_shares(
    model: ThermalModel, courses: Sequence[Conditions]
) -> dict[Sensor, float]:
    """Return the estimated rounding error of each compensated sensor in single precision.

    It is a share of the range of the correction over the courses.
    """
    shares: dict[Sensor, float] = {}
    for sensor in SENSORS:
        if sensor not in model.sensors:
            continue
        part = model.sensors[sensor]
        errors, sizes = zip(*(_error_and_size(part, c.of(sensor)) for c in courses), strict=True)
        span = float(np.ptp(np.concatenate(errors)))
        if span > 0.0:
            shares[sensor] = ROUNDING_PER_TERM * float(np.concatenate(sizes).max()) / span
    return shares


def _error_and_size(part: SensorModel, conditions: Conditions) -> tuple[FloatArray, FloatArray]:
    """Return the (n, 3) error and the (n, 3) sum of its terms' sizes, as C adds them [unit]."""
    plan = plan_of(part)
    size = np.zeros((len(conditions), 3))
    for effect, coefficients in zip(plan.effects, plan.coefficients, strict=True):
        if all(conditions.has(channel) for channel in effect.needs):
            columns = columns_from(effect, conditions, (plan.low, plan.high))[0]
            size += _size(effect, conditions.sensor, np.nan_to_num(columns), coefficients)
    return sensor_error(plan, conditions, uncertain=False).error, size


def _size(
    effect: Effect, sensor: Sensor, columns: FloatArray, coefficients: FloatArray
) -> FloatArray:
    """Return the (n, 3) sum of the sizes of an effect's terms [unit]."""
    made = effect.c_columns(CForm(sensor, Signals(), effect.name, effect.needs, held=effect.bends))
    mixing = None if made is None else made.mixing
    if mixing is not None:
        columns, coefficients = columns @ np.linalg.pinv(mixing), mixing @ coefficients
    size: FloatArray = np.abs(columns) @ np.abs(coefficients)
    return size
