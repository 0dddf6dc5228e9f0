# SPDX-License-Identifier: Apache-2.0
"""The status names what happened, and stops naming it when it is over."""

from types import SimpleNamespace
from typing import Any

import pytest
from imu_driver.board.session import SessionConfig
from imu_driver.board.stream_statistics import StreamStatistics
from imu_driver.driver import DriverParameters
from imu_driver.driver_status import WARNING_CALLS, DriverStatus
from imu_driver.emulator.board import BoardOptions
from imu_driver.wire.frames import CommandCode

OK, WARN, ERROR = 0, 1, 2


class Watched:
    """A emulation whose samples count as published and whose status is asked for each second."""

    def __init__(self, emulation: Any, **options: Any) -> None:
        self.statistics = StreamStatistics()
        self.emulation = emulation(on_samples=self._publish, **options)
        self.reader = SimpleNamespace(
            running=True, connected=True, reconnects=0, connection_error=''
        )
        driver = SimpleNamespace(
            parameters=DriverParameters(),
            statistics=self.statistics,
            session=self.emulation.session,
            device_reader=self.reader,
        )
        self.status = DriverStatus(driver)

    def _publish(self, samples: list[Any]) -> None:
        for sample in samples:
            self.statistics.add(sample)

    def after(self, second: float) -> tuple[int, str, dict[str, Any]]:
        self.emulation.run(until=second)
        return self.status.report(self.emulation.ns())


def test_a_quiet_line(emulation: Any) -> None:
    watched = Watched(emulation)
    watched.after(1.0)
    level, line, values = watched.after(2.0)
    assert (level, line) == (OK, '238.0 Hz')
    assert values['rate_hz'] == pytest.approx(238.0, rel=1e-3)
    assert values['jitter_ms'] < 0.1
    assert values['temperature_c'] == 20.0
    assert values['device'] == 'DUT1'
    assert values['registers'].startswith('CTRL_REG1_G=80 ')
    assert values['samples_received'] + values['samples_lost'] == watched.emulation.line.sent


def test_damage_is_told_for_ten_seconds(emulation: Any) -> None:
    watched = Watched(emulation, faults=('bit_flips@1.5+1',))
    levels = [watched.after(float(second))[:2] for second in range(1, 16)]
    assert levels[0][0] == OK
    assert levels[2][0] == WARN
    assert 'samples_lost' in levels[2][1]
    assert 'crc_errors' in levels[2][1]
    assert [level for level, _ in levels[2 : 1 + WARNING_CALLS]] == [WARN] * (WARNING_CALLS - 1)
    assert levels[-1][0] == OK


def test_a_wrong_rate(emulation: Any) -> None:
    watched = Watched(emulation, faults=('wrong_rate@1+60',))
    watched.after(1.0)
    watched.after(2.0)
    level, line, _ = watched.after(3.0)
    assert level == WARN
    assert 'rate is 166.6 Hz, nominal 238.0 Hz' in line


def test_silence_and_absence(emulation: Any) -> None:
    watched = Watched(emulation, faults=('silence@1+60',))
    watched.after(1.0)
    level, line, _ = watched.after(3.0)
    assert (level, line.split(';')[0]) == (ERROR, 'no data')
    watched.reader.connected, watched.reader.connection_error = False, 'no such file'
    level, line, _ = watched.after(4.0)
    assert (level, line.split(';')[0]) == (ERROR, 'not connected: no such file')
    watched.reader.running = False
    assert 'internal error' in watched.after(5.0)[1]


def test_a_simulated_clock_that_has_not_begun(emulation: Any) -> None:
    watched = Watched(emulation)
    watched.after(1.0)
    level, line, _ = watched.status.report(0)
    assert (level, line.partition(';')[0]) == (
        ERROR,
        'no samples without time: use_sim_time is set and nothing comes on /clock',
    )


def test_what_spoils_a_thermal_campaign(emulation: Any) -> None:
    options = BoardOptions(magnetometer_temperature_compensation=True)
    watched = Watched(emulation, options=options)
    watched.emulation.board._ambient = lambda _: 91.0
    watched.after(1.0)
    level, line, values = watched.after(2.0)
    assert level == WARN
    assert 'die at 91.0 °C, rated -40 … 85 °C' in line
    assert 'compensates its temperature error by itself' in line
    assert values['magnetometer_temperature_compensation'] is True


def test_a_refused_device(emulation: Any) -> None:
    watched = Watched(emulation, config=SessionConfig(device='OTHER'))
    level, line, _ = watched.after(1.0)
    assert level == ERROR
    assert 'refused: device DUT1 is connected, OTHER is wanted' in line


def test_a_restarted_stream_goes_on(emulation: Any) -> None:
    watched = Watched(emulation)
    watched.after(2.0)
    watched.emulation.session.command(CommandCode.STOP)
    watched.emulation.session.command(CommandCode.START)
    before = watched.statistics.published
    level, _, values = watched.after(4.0)
    assert watched.statistics.published > before + 400
    assert values['samples_lost'] == 0
    assert level == OK
