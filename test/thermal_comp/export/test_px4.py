# SPDX-License-Identifier: Apache-2.0
"""Parameter files of PX4 read back, and are subtracted as PX4 computes."""

import numpy as np
import pytest
from thermal_comp.export.cubic import reduced
from thermal_comp.export.px4 import px4_text, read_px4
from thermal_comp.model.values import ModelError

from .cubic_models import CUBIC, ulps


def test_px4_file_reads_back() -> None:
    cubics = {s: reduced(CUBIC, s) for s in ('accelerometer', 'gyroscope')}
    text = px4_text(cubics, 2, {'gyroscope': 3670050}, 'test')
    read = read_px4(text, 2)
    for sensor, cubic in cubics.items():
        assert ulps(cubic.coefficients, read[sensor].coefficients) <= 1.0
        ends = np.array([cubic.reference, cubic.low, cubic.high])
        other = read[sensor]
        assert ulps(ends, np.array([other.reference, other.low, other.high])) <= 1.0
    rows = [line.split('\t') for line in text.splitlines() if not line.startswith('#')]
    assert all(len(row) == 5 and row[:2] == ['1', '1'] for row in rows)
    kinds = {row[2]: row[4] for row in rows}
    assert kinds['TC_G2_ID'] == '6' == kinds['TC_A_ENABLE']
    assert kinds['TC_A2_X3_2'] == '9'
    assert 'TC_A2_ID' not in kinds
    assert read_px4(text, 0) == {}
    with pytest.raises(ModelError, match='TC_A2_TMIN'):
        read_px4(text.replace('TC_A2_TMIN', 'OTHER'), 2)


def test_px4_subtracts_what_the_cubic_says() -> None:
    """In single precision and in the order of powers PX4 computes with."""
    cubic = reduced(CUBIC, 'accelerometer')
    read = read_px4(px4_text({'accelerometer': cubic}, 0, {}, ''), 0)['accelerometer']
    x0, x1, x2, x3 = np.float32(read.coefficients)
    for temperature in (-20.0, -5.0, 12.5, 49.0, 60.0):
        held = np.float32(min(max(temperature, read.low), read.high))
        d = held - np.float32(read.reference)
        offset = x0 + x1 * d + x2 * (d * d) + x3 * (d * d * d)
        np.testing.assert_allclose(offset, cubic.error(np.array([temperature]))[0], atol=2e-7)
