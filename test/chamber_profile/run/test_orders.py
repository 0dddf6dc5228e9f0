# SPDX-License-Identifier: Apache-2.0
"""Orders to a chamber: set-points along a ramp, start and stop, and what it does instead."""

from itertools import pairwise

import numpy as np
import pytest
from chamber_profile.profile.values import ProfileLimits
from chamber_profile.run.orders import ChamberOrders, Ramp, SetpointWriter, advanced
from chamber_profile.run.values import Readings, Switch, WriteSetpoint

LIMITS = ProfileLimits(air_min_c=-15.0, air_max_c=55.0, rate_max_c_per_min=3.0)
RAMP = Ramp(50.0, 2.0)


def orders() -> ChamberOrders:
    return ChamberOrders.within(LIMITS, 0.1, 1.0)


def running(orders: ChamberOrders, setpoint: float) -> ChamberOrders:
    """Orders of a chamber that was told a set-point and confirmed that it runs."""
    orders.begin(0.0)
    orders.write_setpoint(0.0, setpoint, Ramp(setpoint, 0.0))
    orders.keep_running(0.0, Readings(0.0, running=True))
    return orders


@pytest.mark.parametrize('resolution', [0.01, 0.1, 1.0])
def test_written_set_points_stay_within_half_a_write_of_the_ramp(resolution: float) -> None:
    writer = SetpointWriter(resolution, -15.0, 55.0)
    setpoint, worst = 20.0, 0.0
    for now in np.arange(0.0, 800.0, 1.0):
        setpoint = advanced(setpoint, RAMP, 1.0)
        value = writer.due(now, setpoint, RAMP)
        writer = writer if value is None else writer.after(now, value)
        worst = max(worst, abs(writer.written - setpoint))
    assert worst <= 2.0 / 60.0 * 3.5 + resolution / 2 + 1e-9


def test_a_set_point_is_written_every_five_seconds_at_most_and_only_on_change() -> None:
    told = orders()
    writes = [
        (now, action)
        for now in range(60)
        for action in told.write_setpoint(now, 20.0 + now / 30.0, RAMP)
    ]
    assert {b[0] - a[0] for a, b in pairwise(writes)} == {5}
    assert told.write_setpoint(100, 30.0, Ramp(30.0, 0.0)) == [WriteSetpoint(30.0)]
    assert told.write_setpoint(200, 30.0, Ramp(30.0, 0.0)) == []


def test_no_set_point_outside_the_limits_is_written() -> None:
    assert SetpointWriter(1.0, -15.5, 55.5).due(0.0, 55.5, Ramp(55.5, 0.0)) == 55.0
    assert SetpointWriter(1.0, -15.5, 55.5).due(0.0, -15.5, Ramp(-15.5, 0.0)) == -15.0


def test_the_chamber_is_started_once_its_set_point_is_written_and_only_once() -> None:
    told, off = orders(), Readings(0.0, running=False)
    told.begin(0.0)
    assert told.keep_running(0.0, off) == []
    told.write_setpoint(0.0, 20.0, Ramp(20.0, 0.0))
    assert told.keep_running(0.0, off) == [Switch(True)]
    assert told.keep_running(4.0, off) == []
    assert told.keep_running(5.0, off) == [Switch(True)]  # no effect yet: repeated
    assert told.keep_running(6.0, Readings(6.0, running=True)) == []
    assert told.keep_running(60.0, off) == []
    assert told.violation(60.0, off) == 'the chamber was stopped at its panel'


def test_a_chamber_that_does_not_start_in_time_violates_its_orders() -> None:
    told, off = orders(), Readings(0.0, running=False)
    told.begin(0.0)
    assert told.violation(60.0, off) == ''
    assert told.violation(61.0, off) == 'the chamber does not start'
    assert running(orders(), 20.0).violation(61.0, Readings(61.0, running=True)) == ''


def test_another_set_point_is_written_again_and_then_a_violation() -> None:
    told = running(orders(), 20.0)
    other = Readings(0.0, running=True, setpoint=25.0)
    assert told.violation(1.0, other) == ''
    assert told.violation(6.0, other) == ''
    assert told.write_setpoint(6.0, 20.0, Ramp(20.0, 0.0)) == [WriteSetpoint(20.0)]
    assert told.violation(62.0, other) == 'the chamber holds 25 °C instead of 20 °C'


def test_a_chamber_is_stopped_until_it_reports_stand_by() -> None:
    told, on = orders(), Readings(0.0, running=True)
    assert told.keep_stopped(0.0, on) == [Switch(False)]
    assert told.keep_stopped(1.0, on) == []
    assert told.keep_stopped(5.0, on) == [Switch(False)]
    assert told.keep_stopped(9.0, Readings(9.0, running=False)) == []
    assert told.keep_stopped(10.0, Readings(10.0, running=False, link='failing')) == [
        Switch(False)
    ]
