# SPDX-License-Identifier: Apache-2.0
"""The datasheet's tables agree with each other."""

import numpy as np
import pytest
from imu_driver.board import lsm9ds1
from imu_recording.recording import STANDARD_GRAVITY

UNIT = {
    'gyroscope': lsm9ds1.RADIANS_PER_DEGREE,
    'accelerometer': STANDARD_GRAVITY,
    'magnetometer': lsm9ds1.TESLA_PER_GAUSS,
}


@pytest.mark.parametrize('sensor', lsm9ds1.SENSORS)
def test_counts_reach_the_full_scale(sensor: str) -> None:
    for full_scale, sensitivity in lsm9ds1.SENSITIVITY[sensor].items():
        reach = sensitivity * -lsm9ds1.COUNT_MIN / UNIT[sensor] / full_scale
        # 16 g reaches 24 g, and the gyroscope 17 % over; no range is short of its name by 1 %.
        assert 0.99 < reach < 1.51
        assert full_scale in lsm9ds1.FULL_SCALE_CODES[sensor]
    assert lsm9ds1.DEFAULT_FULL_SCALE[sensor] == min(lsm9ds1.SENSITIVITY[sensor])


def test_the_coarsest_accelerometer_range_is_not_eight_times_the_finest() -> None:
    steps = lsm9ds1.SENSITIVITY['accelerometer']
    assert steps[16.0] / steps[2.0] == pytest.approx(12.0)


def test_an_unknown_full_scale_is_named() -> None:
    with pytest.raises(ValueError, match=r'accelerometer full scale 6 g .* 2, 4, 8, 16'):
        lsm9ds1.scale('accelerometer', 6.0)


def test_only_the_magnetometers_x_axis_is_turned() -> None:
    signs = [np.sign(lsm9ds1.scale(s, lsm9ds1.DEFAULT_FULL_SCALE[s])) for s in lsm9ds1.SENSORS]
    np.testing.assert_array_equal(signs, [[1, 1, 1], [1, 1, 1], [-1, 1, 1]])
