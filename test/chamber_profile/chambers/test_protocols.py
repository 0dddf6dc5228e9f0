# SPDX-License-Identifier: Apache-2.0
"""Every protocol: the whole interface of a chamber on an emulator, over a socket and a pty."""

import termios
import time

import pytest
from chamber_profile.chambers.catalogue import CHAMBERS
from chamber_profile.chambers.chamber import ChamberError, ChamberRefusalError
from chamber_profile.emulators.chamber import SERVERS

WIRES = [(name, wire) for name in sorted(SERVERS) for wire in ('tcp', 'serial')]


def wire_of(chamber):
    """Return the line below a chamber's driver."""
    return chamber._line if hasattr(chamber, '_line') else chamber._registers.line


def test_every_protocol_has_a_driver_and_an_emulator() -> None:
    assert set(CHAMBERS) == set(SERVERS)


@pytest.mark.parametrize(('protocol', 'wire'), WIRES)
def test_a_chamber_is_driven_through_its_protocol(emulator, protocol: str, wire: str) -> None:
    chamber, body, clock = emulator(protocol, wire)
    assert 'EMULATED' in chamber.connect()
    assert chamber.emulated
    first = chamber.read()
    assert not first.running
    assert first.alarms == ()
    assert first.air == pytest.approx(body.chamber.read().air, abs=0.06)
    if chamber.programs_limits:
        chamber.set_limits(-15.0, 55.0)
        assert body.chamber.limits == (-15.0, 55.0)
    chamber.set_temperature(-10.0)
    assert chamber.read().setpoint == -10.0
    assert not chamber.read().running
    chamber.run()
    assert chamber.read().running
    for second in range(0, 1201, 60):
        clock[0] = float(second)
        reading = chamber.read()
    assert reading.air < 18.0
    assert reading.setpoint == -10.0
    chamber.stop()
    assert not chamber.read().running
    chamber.close()


@pytest.mark.parametrize('protocol', sorted(SERVERS))
@pytest.mark.parametrize('fault', ['silence', 'garbage', 'half_line', 'bad_crc', 'disconnect'])
def test_a_broken_line_is_a_chamber_error_and_heals(emulator, protocol: str, fault: str) -> None:
    chamber, _, clock = emulator(protocol, 'tcp', f'{fault}@10+5')
    chamber.connect()
    before = chamber.read().air
    wire_of(chamber).timeout_s = 0.15
    clock[0] = 11.0
    with pytest.raises(ChamberError):
        chamber.read()
    clock[0] = 16.0
    wire_of(chamber).timeout_s = 1.0
    chamber.connect()
    assert chamber.read().air == pytest.approx(before, abs=0.5)


@pytest.mark.parametrize('fault', ['silence', 'garbage', 'half_line', 'bad_crc', 'disconnect'])
def test_a_broken_serial_line_heals(emulator, fault: str) -> None:
    chamber, _, clock = emulator('watlow_f4', 'serial', f'{fault}@10+5')
    chamber.connect()
    wire_of(chamber).timeout_s = 0.15
    clock[0] = 11.0
    with pytest.raises(ChamberError):
        chamber.read()
    clock[0] = 16.0
    wire_of(chamber).timeout_s = 1.0
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        try:
            chamber.connect()
            break
        except ChamberError:
            continue
    assert chamber.read().air == pytest.approx(23.0, abs=2.0)


def test_a_port_that_goes_this_very_moment_is_a_broken_link(emulator, monkeypatch) -> None:
    chamber, _, _ = emulator('watlow_f4', 'serial')
    chamber.connect()

    def gone() -> None:
        raise termios.error(5, 'Input/output error')

    monkeypatch.setattr(wire_of(chamber)._serial, 'reset_input_buffer', gone)
    with pytest.raises(ChamberError, match='the link broke'):
        chamber.read()
    chamber.connect()
    assert chamber.read().air == pytest.approx(23.0, abs=2.0)


@pytest.mark.parametrize('protocol', sorted(SERVERS))
def test_refusals_alarms_and_the_stop_button_are_reported(emulator, protocol: str) -> None:
    chamber, _, clock = emulator(
        protocol, 'tcp', 'refusals@10+5', 'alarms@20+5', 'operator_stop@30'
    )
    chamber.connect()
    chamber.run()
    clock[0] = 11.0
    with pytest.raises(ChamberRefusalError):
        chamber.set_temperature(30.0)
    clock[0] = 21.0
    reading = chamber.read()
    assert reading.alarms or not reading.running
    clock[0] = 26.0
    chamber.run()
    assert chamber.read().running
    clock[0] = 31.0
    assert not chamber.read().running


def test_a_stuck_compressor_leaves_the_air_warm(emulator) -> None:
    chamber, _, clock = emulator('espec', 'tcp', 'stuck_compressor@0')
    chamber.connect()
    chamber.set_temperature(-10.0)
    chamber.run()
    clock[0] = 1800.0
    assert chamber.read().air > 20.0


@pytest.mark.parametrize('protocol', sorted(SERVERS))
def test_setpoints_outside_the_chambers_limits_are_refused(emulator, protocol: str) -> None:
    chamber, _, _ = emulator(protocol, 'tcp')
    chamber.connect()
    with pytest.raises(ChamberRefusalError):
        chamber.set_temperature(400.0)
