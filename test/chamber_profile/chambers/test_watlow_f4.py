# SPDX-License-Identifier: Apache-2.0
"""The F4 driver reads and writes the controller's documented registers."""

import pytest
from chamber_profile.chambers.chamber import ChamberRefusalError
from chamber_profile.chambers.watlow_f4 import WatlowF4Chamber


class Registers:
    """A controller's registers; those that are missing are refused."""

    def __init__(self, **values: int) -> None:
        self.values = {606: 1, 901: 1, 602: -400, 603: 1000, 100: -105, 300: 200, 2000: 0, 200: 0}
        self.values |= {int(name[1:]): value for name, value in values.items()}
        self.written: list[tuple[int, int]] = []

    def open(self) -> None:
        """There is nothing to open."""

    def read(self, register: int, count: int = 1) -> list[int]:
        if register not in self.values:
            raise ChamberRefusalError('illegal address')
        return [self.values[register + i] for i in range(count)]

    def write(self, register: int, value: int) -> None:
        self.written.append((register, value))
        self.values[register] = value


def test_temperatures_follow_the_number_of_decimals() -> None:
    chamber = WatlowF4Chamber(Registers())
    assert chamber.connect() == 'Watlow F4, 1 decimals, limits -40 … 100 °C'
    assert not chamber.emulated
    assert (chamber.read().air, chamber.read().setpoint) == (-10.5, 20.0)
    assert chamber.resolution_c == 0.1
    fine = WatlowF4Chamber(Registers(r606=2))
    fine.connect()
    assert (fine.read().air, fine.resolution_c) == (-1.05, 0.01)
    fine.set_temperature(-7.5)
    assert fine._registers.written == [(300, -750)]


@pytest.mark.parametrize('wrong', [{'r901': 0}, {'r606': 9}])
def test_a_controller_in_fahrenheit_or_of_another_kind_is_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ChamberRefusalError, match='set the controller to °C'):
        WatlowF4Chamber(Registers(**wrong)).connect()


def test_a_profile_of_the_controllers_own_is_ended_before_the_chamber_is_switched_on() -> None:
    registers = Registers(r200=2, r2010=0)
    WatlowF4Chamber(registers, cond_event=2).run()
    assert registers.written == [(1217, 1), (2010, 1)]


def test_the_eeprom_is_never_written() -> None:
    registers = Registers()
    chamber = WatlowF4Chamber(registers)
    chamber.connect()
    chamber.set_limits(-10.0, 50.0)
    chamber.set_temperature(20.0)
    chamber.run()
    chamber.stop()
    assert 25 not in {register for register, _ in registers.written}


def test_limits_that_are_not_taken_are_an_error() -> None:
    class Stubborn(Registers):
        def write(self, register: int, value: int) -> None:
            """Take nothing."""

    with pytest.raises(ChamberRefusalError, match='limits -10 … 50 °C were not taken'):
        WatlowF4Chamber(Stubborn()).set_limits(-10.0, 50.0)
