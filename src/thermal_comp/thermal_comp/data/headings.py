# SPDX-License-Identifier: Apache-2.0
"""How a device was turned about the vertical from run to run, and its hard iron: by mean fields.

The mean reading of run r is R_r B + b with one field B of the chamber and one offset b of the
device, R_r the rotation from the chamber's frame into the sensor's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.linear.columns import LEAST_NEW_LENGTH

LEAST_FIELD_T = 1e-5
"""Least field that is Earth's [T]: 22 to 67 µT outside, less in a chamber of steel."""
LARGEST_MISFIT_SHARE = 0.2
"""Rms that one field and one offset may leave, as a share of the field: fixtures turn by right
angles to some degrees, and iron near by bends the field by as much."""
MOST_RUNS = 5
"""Runs whose headings are found together."""
LARGEST_RIGHT_SHARE, LEAST_WRONG_SHARE = 0.02, 0.05
"""Rms that right headings leave, as a share of the field, at most, and wrong ones at least: a
fixture leans by a degree, and a heading that is no right angle leaves more."""
LARGEST_SHARE_OF_USUAL, LARGEST_SHARE_OF_SECOND = 0.25, 0.5
"""Rms that the right headings leave, as a share of that of the fixture's usual ones, and of that
of the next best."""
QUARTER_TURN: FloatArray = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class _MeanField:
    """The field of the chamber and the offset of the device nearest to the mean readings."""

    field: float
    """Size of the field [T]."""
    offset: FloatArray
    """(3,) [T]."""
    misfit: float
    """Rms of what they leave [T]."""
    is_told: bool
    """Whether the orientations tell all of them but what lies along one axis."""

    @classmethod
    def of(cls, rotations: Sequence[FloatArray], readings: FloatArray) -> _MeanField:
        design = np.concatenate([np.hstack([rotation, np.eye(3)]) for rotation in rotations])
        answer, _, rank, _ = np.linalg.lstsq(design, readings.ravel(), rcond=LEAST_NEW_LENGTH)
        misfit = float(np.sqrt(np.mean((readings.ravel() - design @ answer) ** 2)))
        field = float(np.linalg.norm(answer[:3]))
        is_told = bool(rank >= design.shape[1] - 1 and field > LEAST_FIELD_T)
        return cls(field, answer[3:], misfit, is_told)


def hard_iron_of(runs: Sequence[Conditions]) -> FloatArray | None:
    """Return the magnetometer's (3,) constant offset [T], None where orientations do not tell it.

    Two orientations leave open how much along the axis of the turn between them is field, and so
    do the paper's three, which turn about one axis: the answer of least norm takes half of it for
    field.
    """
    known = _rotations_and_readings(runs)
    if known is None:
        return None
    found = _MeanField.of(*known)
    if not found.is_told or found.misfit > LARGEST_MISFIT_SHARE * found.field:
        return None
    return found.offset


def turned_orientations(runs: Sequence[Conditions]) -> list[FloatArray] | None:
    """Return the rotations (3, 3) of runs that were turned about the vertical in another way.

    Which axis points up does not say where north is. Where the fixture's usual headings leave much
    more of the mean readings than others, by right angles from run to run, it was turned by these.
    None where the usual ones hold, or nothing is told: three runs and more tell it.
    """
    known = _rotations_and_readings(runs)
    if known is None or not 3 <= len(runs) <= MOST_RUNS:
        return None
    usual, readings = known
    default = _MeanField.of(usual, readings)
    if default.misfit <= LEAST_WRONG_SHARE * default.field:
        return None
    turns = [np.linalg.matrix_power(QUARTER_TURN, k) for k in range(4)]
    choices = [
        [usual[0], *(one @ turn for one, turn in zip(usual[1:], chosen, strict=True))]
        for chosen in product(turns, repeat=len(runs) - 1)
    ]
    fits = [_MeanField.of(rotations, readings) for rotations in choices]
    best, second = np.argsort([fit.misfit for fit in fits], kind='stable')[:2]
    found = fits[best]
    is_better = found.misfit < min(
        LARGEST_RIGHT_SHARE * found.field,
        LARGEST_SHARE_OF_USUAL * default.misfit,
        LARGEST_SHARE_OF_SECOND * fits[second].misfit,
    )
    if not found.is_told or not is_better:
        return None
    return choices[best]


def _rotations_and_readings(
    runs: Sequence[Conditions],
) -> tuple[list[FloatArray], FloatArray] | None:
    """Return the rotations and (r, 3) mean readings [T] of all runs; None where one has none."""
    rotations = [run.orientation for run in runs if run.orientation is not None]
    if not rotations or len(rotations) < len(runs):
        return None
    readings = np.stack([run.magnetic_field[0] for run in runs])
    return (rotations, readings) if np.isfinite(readings).all() else None
