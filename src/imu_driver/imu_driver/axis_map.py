# SPDX-License-Identifier: Apache-2.0
"""How a sensor's axes lie in the published frame, and the six positions that check it.

>>> parse_axis_map('-y +x +z')
((1, -1), (0, 1), (2, 1))
>>> try:
...     parse_axis_map('-x +y +z')
... except AxisMapError as error:
...     print(error)
axis map '-x +y +z' mirrors (determinant -1): a right-handed frame stays so only under +1
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final, TypeAlias

import numpy as np
from imu_recording.recording import UP_AXES, FloatArray
from imu_recording.user_error import UserError

from imu_driver.lsm9ds1 import STANDARD_GRAVITY

AxisMap: TypeAlias = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""For each published axis: index of the sensor's axis, sign."""

IDENTITY: Final[AxisMap] = ((0, 1), (1, 1), (2, 1))


class AxisMapError(UserError):
    """An axis map that is no rotation; the message names it."""


def parse_axis_map(text: str) -> AxisMap:
    """Return the map of a text such as '+x +y +z': the sensor axis along published x, y, z.

    Raises AxisMapError unless it is a rotation (each axis once, determinant +1).
    """
    found = re.findall(r'([+-]?)([xyz])', text)
    if re.sub(r'[+-]?[xyz]|[\s,]', '', text) or sorted(axis for _, axis in found) != [*'xyz']:
        raise AxisMapError(f'axis map {text!r}: expected each of x, y, z once, e.g. "-y +x +z"')
    first, second, third = (('xyz'.index(axis), -1 if sign == '-' else 1) for sign, axis in found)
    axis_map = (first, second, third)
    determinant = round(float(np.linalg.det(rotation(axis_map))))
    if determinant != 1:
        raise AxisMapError(
            f'axis map {text!r} mirrors (determinant {determinant}): '
            'a right-handed frame stays so only under +1'
        )
    return axis_map


def rotation(axis_map: AxisMap) -> FloatArray:
    """Return (3, 3) the matrix from sensor to published axes."""
    matrix = np.zeros((3, 3))
    for row, (column, sign) in enumerate(axis_map):
        matrix[row, column] = sign
    return matrix


def up_axis(linear_acceleration: Sequence[float]) -> str:
    """Return which axis points up, one of UP_AXES: the one that reads +g at rest."""
    axis = max(range(3), key=lambda i: abs(linear_acceleration[i]))
    return f'{"+" if linear_acceleration[axis] > 0 else "-"}{"xyz"[axis]}'


def check_six_positions(
    linear_acceleration: Mapping[str, Sequence[float]], tolerance: float = 1.5
) -> list[str]:
    """Return what is wrong with six readings at rest, one sentence each; empty if nothing is.

    `linear_acceleration` maps the marked axis that pointed up (UP_AXES) to the mean reading
    [m/s²]. Each must read +g along that axis within `tolerance` [m/s²]. One wrong sign or one
    swapped pair shows as a mirrored frame; two wrong signs as a rotated one.
    """
    faults = [f'position {axis} is missing' for axis in UP_AXES if axis not in linear_acceleration]
    rows = []
    for axis in UP_AXES:
        if axis not in linear_acceleration:
            continue
        expected = np.zeros(3)
        expected['xyz'.index(axis[1])] = STANDARD_GRAVITY * (1 if axis[0] == '+' else -1)
        reading = np.asarray(linear_acceleration[axis], dtype=float)
        rows.append((expected, reading))
        if np.abs(reading - expected).max() > tolerance:
            values = ', '.join(f'{value:.2f}' for value in reading)
            faults.append(
                f'with {axis} up the sensor reads [{values}] m/s²: its {up_axis([*reading])} is up'
            )
    if len(rows) == len(UP_AXES):
        expected_rows, readings = (np.array(part) for part in zip(*rows, strict=True))
        fitted = np.linalg.lstsq(expected_rows, readings, rcond=None)[0]
        if np.linalg.det(fitted) < 0:
            faults.append('the accelerometer frame is mirrored: no axis map can make it right')
    return faults
