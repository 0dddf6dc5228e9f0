# SPDX-License-Identifier: Apache-2.0
"""Parameter files of ArduPilot read back, and are subtracted as ArduPilot computes."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.export.ardupilot import ardupilot_text, read_ardupilot
from thermal_comp.export.cubic import reduced

from .cubic_models import CUBIC, CURVE, LINE, ulps


def test_ardupilot_file_reads_back_and_subtracts_the_change_since_its_calibration() -> None:
    cubics = {s: reduced(CUBIC, s) for s in ('accelerometer', 'gyroscope')}
    text = ardupilot_text(cubics, 0, 'test')
    read = read_ardupilot(text, 0)
    for sensor, cubic in cubics.items():
        exact = 1e6 * cubic.about(35.0).coefficients[1:]
        assert ulps(exact, 1e6 * read[sensor].coefficients[1:]) <= 1.0
        t, calibrated = np.array([12.5]), np.array([31.0])
        change = read[sensor].error(t) - read[sensor].error(calibrated)
        expected = cubic.error(t) - cubic.error(calibrated)
        np.testing.assert_allclose(change, expected, atol=1e-7)
    lines = dict(line.split() for line in text.splitlines()[1:])
    assert len(lines) == 3 + 18
    assert lines['INS_TCAL1_ENABLE'] == '1'
    x = 1e6 * (LINE[0, 1] + 2 * CURVE[0, 1] * 15.0 + 3 * CURVE[1, 1] * 15.0**2)
    assert float(lines['INS_TCAL1_GYR1_Y']) == pytest.approx(x, rel=1e-6)
    assert not any('e' in value for value in lines.values())


def test_ardupilot_range_stays_within_what_it_takes() -> None:
    wide = replace(reduced(CUBIC, 'gyroscope'), low=-80.0, high=85.0)
    cubic = read_ardupilot(ardupilot_text({'gyroscope': wide}, 1, ''), 1)['gyroscope']
    assert (cubic.low, cubic.high) == (-70.0, 80.0)
