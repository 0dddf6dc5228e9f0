# SPDX-License-Identifier: Apache-2.0
"""Every protocol: bytes as in the manufacturers' notes, and the whole interface on an emulator."""

import threading
import time
from pathlib import Path

import pytest
from chamber_profile.chambers import modbus
from chamber_profile.chambers.catalogue import CHAMBERS, ChamberAddressError, open_chamber
from chamber_profile.chambers.chamber import ChamberError, ChamberRefusalError
from chamber_profile.emulated_chamber import SERVERS
from chamber_profile.emulation.body import EmulatedBody
from chamber_profile.emulation.endpoint import PtyEndpoint, TcpEndpoint
from chamber_profile.emulation.espec_server import EspecServer
from chamber_profile.emulation.faults import Fault, FaultPlan, parse_fault
from chamber_profile.emulation.votsch_server import Ascii2Server, SimservServer
from chamber_profile.emulation.watlow_server import WatlowRtuServer

WIRES = [(name, wire) for name in sorted(SERVERS) for wire in ('tcp', 'serial')]


@pytest.fixture
def emulator(tmp_path: Path):
    """Serve a protocol in a thread; its clock is `clock[0]`, set by hand."""
    running = []

    def start(protocol: str, wire: str, *faults: str):
        body = EmulatedBody(seed=1)
        plan = FaultPlan([parse_fault(text) for text in faults], body)
        clock = [0.0]

        def make_server():
            return SERVERS[protocol](body, 0, wire == 'tcp')

        if wire == 'tcp':
            endpoint = TcpEndpoint(0, make_server)
            address = f'{protocol}+{endpoint.name}'
        else:
            endpoint = PtyEndpoint(tmp_path / 'chamber', make_server)
            address = f'{protocol}+{endpoint.name}'
        stop = threading.Event()

        def serve() -> None:
            def prepare():
                body.look(clock[0])
                return plan.look(clock[0])

            while not stop.is_set():
                endpoint.serve(0.01, prepare)
            endpoint.close()

        thread = threading.Thread(target=serve)
        thread.start()
        running.append((stop, thread))
        chamber = open_chamber(address)
        return chamber, body, clock

    yield start
    for stop, thread in running:
        stop.set()
        thread.join()


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
    chamber._line.timeout_s = 0.15
    clock[0] = 11.0
    with pytest.raises(ChamberError):
        chamber.read()
    clock[0] = 16.0
    chamber._line.timeout_s = 1.0
    chamber.connect()
    assert chamber.read().air == pytest.approx(before, abs=0.5)


@pytest.mark.parametrize('fault', ['silence', 'garbage', 'half_line', 'bad_crc', 'disconnect'])
def test_a_broken_serial_line_heals(emulator, fault: str) -> None:
    chamber, _, clock = emulator('watlow_f4', 'serial', f'{fault}@10+5')
    chamber.connect()
    chamber._line.timeout_s = 0.15
    clock[0] = 11.0
    with pytest.raises(ChamberError):
        chamber.read()
    clock[0] = 16.0
    chamber._line.timeout_s = 1.0
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        try:
            chamber.connect()
            break
        except ChamberError:
            continue
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


# Bytes of the notes ---------------------------------------------------------------------------

ESPEC_BYTES = [
    (b'TEMP?\r\n', 4),
    (b'MON?\r\n', 4),
    (b'ALARM?\r\n', 1),
]


def test_espec_answers_have_the_documented_fields() -> None:
    server = EspecServer(EmulatedBody())
    for request, fields in ESPEC_BYTES:
        (answer,) = server.feed(request)
        assert answer.endswith(b'\r\n')
        assert len(answer.strip().split(b',')) == fields
    for order in (b'TEMP, S25.0', b'TEMP,S25', b'TEMP, S25.0 H100.0 L-40.0', b'MODE,CONSTANT'):
        assert server.feed(order + b'\r\n') == [b'OK:' + order + b'\r\n']
    assert server.feed(b'TEMP, S200.0\r\n') == [b'NA:DATA OUT OF RANGE\r\n']
    assert server.feed(b'COFFEE\r\n') == [b'NA:CMD ERR\r\n']
    assert server.feed(b'MO') == []
    assert server.feed(b'DE?\r\nALARM?\r\n') == [b'CONSTANT\r\n', b'0\r\n']


def test_espec_on_a_bus_answers_its_own_address_only() -> None:
    server = EspecServer(EmulatedBody(), address=1)
    (answer,) = server.feed(b'1,MON?\r\n')
    assert answer.split(b',')[2] == b'STANDBY'
    assert server.feed(b'2,MON?\r\n') == []


def test_ascii2_uses_the_documented_number_format() -> None:
    server = Ascii2Server(EmulatedBody())
    order = (
        b'$01E 0050.0 0080.0 0090.0 0000.0 0000.0 0000.0 0000.0 '
        b'01000000000000000000000000000000\r'
    )
    assert server.feed(order) == [b'0\r']
    (image,) = server.feed(b'$01I\r')
    *values, bits = image.decode().split()
    assert len(values) == 14
    assert values[0] == '0050.0'
    assert {len(value) for value in values} == {6}
    assert bits == '01' + '0' * 30
    assert server.feed(b'$01U 0002.0 0000.0 0000.0 0000.0\r') == [b'0\r']
    assert server.feed(b'$02I\r') == []


def test_ascii2_writes_back_what_it_does_not_mean_to_change(emulator) -> None:
    chamber, _, _ = emulator('ascii2', 'tcp')
    chamber.connect()
    line = chamber._line
    sent = b'$01E 0020.0 0055.0 0090.0 0000.0 0001.0 0000.0 0003.0 001' + b'0' * 29 + b'\r'
    line.ask(sent, len)
    chamber.set_temperature(-7.5)
    chamber.run()
    values, bits = chamber._values()
    assert values[0] == -7.5
    assert values[2::2] == [55.0, 90.0, 0.0, 1.0, 0.0, 3.0]
    assert bits == '011' + '0' * 29


def test_simserv_frames() -> None:
    server = SimservServer(EmulatedBody())
    s = b'\xb6'
    assert server.feed(s.join([b'11001', b'1', b'1', b'-10.0']) + b'\r') == [b'1\r\n']
    assert server.feed(s.join([b'11002', b'1', b'1']) + b'\r') == [b'1' + s + b'-10.0\r\n']
    assert server.feed(s.join([b'14001', b'1', b'1', b'1']) + b'\r') == [b'1\r\n']
    assert server.feed(s.join([b'10012', b'1']) + b'\r') == [b'1' + s + b'3\r\n']
    assert server.feed(s.join([b'12345', b'1']) + b'\r') == [b'-5\r\n']
    assert server.feed(s.join([b'11001', b'1', b'1', b'abc']) + b'\r') == [b'-6\r\n']


FRAMES = {
    'read PV': (modbus.read_pdu(100), '01 03 00 64 00 01 C5 D5'),
    'read decimals': (modbus.read_pdu(606), '01 03 02 5E 00 01 E4 60'),
    'SP = 50.0': (modbus.write_pdu(300, 500), '01 06 01 2C 01 F4 49 E8'),
    'SP = -10.0': (modbus.write_pdu(300, -100), '01 06 01 2C FF 9C 08 66'),
    'event 1 on': (modbus.write_pdu(2000, 1), '01 06 07 D0 00 01 48 87'),
    'terminate': (modbus.write_pdu(1217, 1), '01 06 04 C1 00 01 18 C6'),
    'start profile 1': (
        modbus.write_many_pdu(4000, [1, 1, 5]),
        '01 10 0F A0 00 03 06 00 01 00 01 00 05 7C 15',
    ),
    'status': (modbus.read_pdu(200), '01 03 00 C8 00 01 05 F4'),
}


@pytest.mark.parametrize('name', FRAMES)
def test_modbus_frames_are_those_of_the_notes_byte_for_byte(name: str) -> None:
    pdu, frame = FRAMES[name]
    assert modbus.rtu_frame(1, pdu) == bytes.fromhex(frame)


@pytest.mark.parametrize(
    ('request_pdu', 'answer', 'values'),
    [
        (modbus.read_pdu(100), '01 03 02 FF 97 B8 1A', [-105]),
        (modbus.read_pdu(606), '01 03 02 00 01 79 84', [1]),
        (modbus.write_pdu(300, 500), '01 06 01 2C 01 F4 49 E8', []),
    ],
)
def test_modbus_answers_of_the_notes_are_understood(request_pdu, answer: str, values) -> None:
    frame = bytes.fromhex(answer)
    assert modbus.rtu_answer_length(frame[:3]) == len(frame)
    assert modbus.answer_values(request_pdu, modbus.rtu_pdu(1, frame)) == values


def test_modbus_exceptions_wrong_crc_and_wrong_address() -> None:
    frame = bytes.fromhex('01 83 02 C0 F1')
    with pytest.raises(modbus.ModbusRefusalError, match='illegal address'):
        modbus.answer_values(modbus.read_pdu(9), modbus.rtu_pdu(1, frame))
    with pytest.raises(modbus.ModbusError, match='CRC'):
        modbus.rtu_pdu(1, bytes.fromhex('01 83 02 C0 F0'))
    with pytest.raises(modbus.ModbusError, match='address 1'):
        modbus.rtu_pdu(2, frame)
    tcp = modbus.tcp_frame(1, 1, modbus.read_pdu(100))
    assert tcp.hex(' ') == '00 01 00 00 00 06 01 03 00 64 00 01'


def test_the_emulated_f4_answers_the_frames_of_the_notes() -> None:
    server = WatlowRtuServer(EmulatedBody())
    for name in ('SP = 50.0', 'SP = -10.0', 'event 1 on', 'terminate'):
        frame = bytes.fromhex(FRAMES[name][1])
        assert server.feed(frame[:5]) == []
        assert server.feed(frame[5:]) == [frame]
    assert server.feed(bytes.fromhex('01 03 02 5E 00 01 E4 60')) == [
        bytes.fromhex('01 03 02 00 01 79 84')
    ]
    unknown = modbus.rtu_frame(1, modbus.read_pdu(9))
    assert server.feed(unknown) == [bytes.fromhex('01 83 02 C0 F1')]


# Addresses ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('address', 'words'),
    [
        ('coffee+tcp://localhost:1', 'protocols: simulated, ascii2, espec, simserv, watlow_f4'),
        ('espec', 'write e.g.'),
        ('espec+tcp://localhost', 'tcp://HOST:PORT'),
        ('espec+tcp://localhost:99999', '99999'),
        ('espec+serial://ttyUSB0', 'serial:///dev'),
        ('espec+tcp://h:1?baud=3', "option 'baud'; known: baudrate, timeout, address"),
        ('espec+tcp://h:1?address=x', 'no whole number'),
        ('simulated?seed=x', 'no whole number'),
    ],
)
def test_an_address_that_names_no_chamber_says_what_would(address: str, words: str) -> None:
    with pytest.raises(ChamberAddressError) as caught:
        open_chamber(address)
    assert words in str(caught.value)


def test_address_options_reach_the_driver() -> None:
    chamber = open_chamber('espec+serial:///dev/ttyUSB7?address=3&baudrate=9600')
    assert chamber._prefix == '3,'
    assert chamber._line.baudrate == 9600
    assert chamber._line.port == '/dev/ttyUSB7'
    with pytest.raises(ChamberError, match='ttyUSB7'):
        chamber.connect()


@pytest.mark.parametrize('text', ['silence', 'coffee@3', 'silence@', 'silence@-3', 'silence@3+'])
def test_a_fault_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match='NAME@SECONDS'):
        parse_fault(text)


def test_faults_last_until_the_end_unless_told_otherwise() -> None:
    assert parse_fault('garbage@3') == Fault('garbage', 3.0)
    assert parse_fault('half-line@3+4') == Fault('half_line', 3.0, 4.0)
