# SPDX-License-Identifier: Apache-2.0
"""The magnetometer's constant offset, which runs in several orientations tell from the field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions

LEAST_FIELD = 1e-5
"""Earth's field is 22 to 67 µT, less in a chamber of steel; one much weaker is none [T]."""
LARGEST_MISFIT = 0.2
"""Share of the field that one field and one offset may leave, rms: fixtures turn by right angles
to some degrees, and iron near by bends the field by as much."""


def hard_iron_of(runs: Sequence[Conditions]) -> FloatArray | None:
    """Return the magnetometer's (3,) offset [T]; None where orientations do not tell it.

    The mean reading of run r is R_r B + b with one field B of the chamber and one offset b of the
    device, R_r the rotation from the chamber's frame into the sensor's. Two orientations leave
    open how much along the axis of the turn between them is field, and so do the paper's three,
    which turn about one axis: the answer of least norm takes half of it for field.
    """
    rotations = [run.orientation for run in runs if run.orientation is not None]
    if not rotations or len(rotations) < len(runs):
        return None
    design = np.concatenate([np.hstack([rotation, np.eye(3)]) for rotation in rotations])
    target = np.concatenate([run.magnetic_field[0] for run in runs])
    if not np.isfinite(target).all():
        return None
    answer, _, rank, _ = np.linalg.lstsq(design, target, rcond=1e-6)
    misfit = float(np.sqrt(np.mean((target - design @ answer) ** 2)))
    field = float(np.linalg.norm(answer[:3]))
    told = rank >= design.shape[1] - 1 and field > LEAST_FIELD
    if not told or misfit > LARGEST_MISFIT * field:
        return None
    return np.asarray(answer[3:])
