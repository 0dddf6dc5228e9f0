# SPDX-License-Identifier: Apache-2.0
"""Curves from stretches at rest of many logs, against the error they were made with."""

import numpy as np
import pytest
from thermal_comp.still.curves import still_curves
from thermal_comp.still.log import resting_log

from .parked import LOGS, OFFSET, SLOPE, G, parked


@pytest.mark.long
def test_error_across_gravity_is_none_along_it() -> None:
    """The norm of gravity and an error across it grows with its square, by 39 mm/s² here."""
    curves = still_curves([resting_log(parked(number))[0] for number in range(LOGS)])
    value, std = curves.curve('accelerometer', np.array([1.0, 43.0]))
    change = value[1] - value[0]
    across = np.square(OFFSET + SLOPE * np.array([[1.0], [43.0]])).sum(axis=1)
    assert np.diff(across)[0] / (2.0 * G) > 0.039
    assert abs(change[2]) < 0.003
    assert abs(change[2]) < 3.0 * np.hypot(*std[:, 2])
