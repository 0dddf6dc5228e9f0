# SPDX-License-Identifier: Apache-2.0
"""A simulated board follows the chamber's air where its address says so, past failed sensors."""

from __future__ import annotations

from math import inf, nan

import pytest
from imu_driver.emulator.chamber_air import INITIAL_AIR_C, ChamberAir, follows_chamber
from imu_driver.emulator.transport import SimulatedTransport


@pytest.mark.parametrize(
    ('url', 'follows'),
    [
        ('simulated://dut1?temperature=chamber', True),
        ('simulated://dut1?seed=2&temperature=chamber&orientation=-z', True),
        ('simulated://dut1?temperature=20', False),
        ('simulated://dut1', False),
        ('tcp://chamber:4000?temperature=chamber', False),
    ],
)
def test_only_a_simulated_board_that_asks_for_it_follows_the_chamber(
    url: str, follows: bool
) -> None:
    assert follows_chamber(url) == follows


def test_the_air_is_the_last_finite_measurement() -> None:
    air = ChamberAir()
    assert air(0.0) == INITIAL_AIR_C
    air.update(-12.5)
    for failed in (nan, inf):
        air.update(failed)
    assert air(0.0) == air(3600.0) == -12.5


def test_the_board_is_as_warm_as_the_chambers_air() -> None:
    air = ChamberAir()
    air.update(60.0)
    line = SimulatedTransport.from_url('simulated://dut1?temperature=chamber', air=air)
    device = line._board._source
    device.sample(0.0, line._board._ambient(0.0))
    assert device.die_temperature == pytest.approx(60.0, abs=5.0)
