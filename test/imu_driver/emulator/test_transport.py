# SPDX-License-Identifier: Apache-2.0
"""The simulated transport: its options, and the ambient temperature of its board."""

from pathlib import Path

import pytest
from imu_driver.emulator.transport import AmbientError, SimulatedTransport, ambient_law


def test_a_number_holds() -> None:
    assert ambient_law('-12.5')(1e6) == -12.5


def test_a_plan_is_interpolated_and_held(tmp_path: Path) -> None:
    path = tmp_path / 'plan.csv'
    rows = '0,20,dwell\n60,20,ramp\n120,22,dwell\n'
    path.write_text(f'# profile\ntime_s,temperature_c,phase\n{rows}')
    law = ambient_law(str(path))
    assert [law(t) for t in (-5.0, 0.0, 60.0, 90.0, 120.0, 500.0)] == [20, 20, 20, 21, 22, 22]


@pytest.mark.parametrize(
    ('text', 'told'),
    [
        ('time_s,celsius\n0,20\n', 'no column temperature_c'),
        ('time_s,temperature_c\n', 'no rows'),
        ('time_s,temperature_c\n0,warm\n', 'warm'),
        ('time_s,temperature_c\n0\n', 'plan.csv'),
        ('time_s,temperature_c\n10,20\n0,20\n', 'must rise'),
    ],
)
def test_a_law_that_cannot_be_read_is_named(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / 'plan.csv'
    path.write_text(text)
    with pytest.raises(AmbientError, match=told):
        ambient_law(str(path))


@pytest.mark.parametrize(
    ('query', 'told'),
    [
        ('orientation=up', 'orientation must be one of'),
        ('protocol=nmea', 'protocol must be'),
        ('seed=x', 'must be numbers'),
        ('temperture=20', 'unknown option temperture'),
    ],
)
def test_a_simulated_transport_that_cannot_be_is_named(query: str, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        SimulatedTransport.from_url(f'simulated://dut1?{query}')


def test_its_surroundings_heat_the_die_faster_under_a_time_scale() -> None:
    now = [0.0]
    transport = SimulatedTransport.from_url('simulated://dut1?temperature=20&time_scale=600', 10.0)
    board = transport._board
    board._ambient = lambda time: 20.0 if time < 1.0 else 60.0
    board.streaming = True
    transport._now, transport._start = lambda: now[0], 0.0
    now[0] = 6.0
    assert transport.read()
    assert board._source.die_temperature > 50.0, 'six seconds of the line are an hour of heat'
