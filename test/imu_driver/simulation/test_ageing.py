# SPDX-License-Identifier: Apache-2.0
"""A device a year later differs by what its ageing says, and by that alone."""

import numpy as np
import pytest
from imu_driver.simulation.ageing import draw_ageing
from imu_driver.simulation.devices import DEVICES
from imu_recording.recording import SENSOR_FIELDS

DEVICE = DEVICES['dut1']


@pytest.mark.parametrize('seed', range(5))
def test_the_aged_device_has_the_changes_that_were_drawn(seed: int) -> None:
    ageing = draw_ageing(DEVICE, seed)
    aged = ageing.of(DEVICE)
    for sensor in SENSOR_FIELDS:
        before, after = DEVICE.sensor(sensor), aged.sensor(sensor)
        np.testing.assert_allclose(after.slope, ageing.slope_ratio[sensor] * before.slope)
        np.testing.assert_allclose(after.bias - before.bias, ageing.offset[sensor], atol=1e-12)
        assert after.turn_on_std is before.turn_on_std
    ratio = DEVICE.glue_conductance / aged.glue_conductance
    assert ratio == pytest.approx(ageing.time_constant_ratio)  # τ = C / G


def test_a_seed_tells_the_whole_change_and_ratios_go_both_ways() -> None:
    assert draw_ageing(DEVICE, 7) == draw_ageing(DEVICE, 7)
    ratios = [draw_ageing(DEVICE, seed).effect_ratio for seed in range(40)]
    assert all(1.2 <= max(ratio, 1.0 / ratio) <= 1.8 for ratio in ratios)
    assert min(ratios) < 1.0 < max(ratios)
