# SPDX-License-Identifier: Apache-2.0
"""How the device stands in the chamber, as far as the axis that points up tells."""

from __future__ import annotations

import numpy as np
from imu_recording.recording import FloatArray


def mounting_rotation(up_axis: str) -> FloatArray:
    """Return the (3, 3) rotation from the chamber's frame (z up) into the sensor's.

    The fixture turns the device cyclically (x up: x = Z, y = X, z = Y); an axis that points down
    is the same mounting turned by half about the axis after it.

    >>> mounting_rotation('+x') @ [0.0, 0.0, 1.0]
    array([1., 0., 0.])
    >>> mounting_rotation('-z') @ [0.0, 0.0, 1.0]
    array([ 0.,  0., -1.])
    """
    axis = 'xyz'.index(up_axis[1])
    rotation: FloatArray = np.roll(np.eye(3), axis + 1, axis=0)
    if up_axis[0] == '-':
        half_turn = -np.ones(3)
        half_turn[(axis + 1) % 3] = 1.0
        rotation = half_turn[:, None] * rotation
    return rotation
