# SPDX-License-Identifier: Apache-2.0
"""The reference logger: lines in any pieces, broken sensors, and the emulator on a real port."""

import re
import subprocess
import sys
import time

import numpy as np
import pytest
from chamber_profile.emulators.reference_logger import LoggerSensors, read_table
from chamber_profile.reference.logger import (
    ColumnError,
    ReferenceLines,
    ReferenceLoggerPort,
    parse_columns,
)
from chamber_profile.reference.node import ReferenceLoggerNode
from hypothesis import given, settings
from hypothesis import strategies as st

COLUMNS = {1: 'air', 2: 'device'}


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-90, 290), st.floats(-90, 290)), min_size=1, max_size=20),
    st.lists(st.integers(1, 30), min_size=1),
)
def test_lines_come_out_whole_however_the_bytes_are_cut(values, cuts) -> None:
    data = b''.join(f'x,{a:.3f},{b:.3f}\r\n'.encode() for a, b in values)
    lines = ReferenceLines(COLUMNS)
    readings, place, number = [], 0, 0
    while place < len(data):
        size = cuts[number % len(cuts)]
        readings += lines.feed(data[place : place + size])
        place, number = place + size, number + 1
    assert [(r['air'], r['device']) for r in readings] == [
        (round(a, 3) + 0.0, round(b, 3) + 0.0) for a, b in values
    ]


def test_a_broken_sensor_is_left_out_and_counted() -> None:
    lines = ReferenceLines(COLUMNS)
    readings = lines.feed(b'0,20.0,21.0\n1,OPEN,21.1\n2,9999,21.2\n3,20.3\nnan,nan,21.4\n')
    assert [reading.get('device') for reading in readings] == [21.0, 21.1, 21.2, None, 21.4]
    assert lines.rejected == {'air': 3, 'device': 1}


def test_the_line_that_was_under_way_is_no_reading() -> None:
    lines = ReferenceLines(COLUMNS)
    assert lines.feed(b'.5\n1,20.0,21.0\n') == [{'air': 20.0, 'device': 21.0}]
    assert lines.rejected == {}


@pytest.mark.parametrize(
    'entries', [[], ['air'], ['x=air'], ['1='], ['1=a', '1=b'], ['1=a', '2=a']]
)
def test_a_column_map_that_maps_nothing_is_refused(entries) -> None:
    with pytest.raises(ColumnError, match='columns'):
        parse_columns(entries)


def test_the_node_publishes_each_column_on_its_topic(ros) -> None:
    sent = []
    node = ReferenceLoggerNode(
        capture=lambda topic, message: sent.append((topic, message)), now=lambda: 5_000_000_007
    )
    assert node.autostart()
    node.on_bytes(b'0.0,20.01,20.02,21.1,21.2,')
    node.on_bytes(b'21.3\r\n')
    assert {topic: message.temperature for topic, message in sent} == {
        'chamber/temperature': 20.01,
        'chamber/temperature_2': 20.02,
        'dut1/chamber/device_temperature': 21.1,
        'dut2/chamber/device_temperature': 21.2,
        'dut3/chamber/device_temperature': 21.3,
    }
    assert {message.header.stamp.nanosec for _, message in sent} == {7}
    assert node.diagnostics()[0] == 0
    node.on_bytes(b'1.0,20.01,OPEN,21.1,21.2,21.3\r\n')
    level, line, _ = node.diagnostics()
    assert level == 1
    assert 'chamber/temperature_2' in line
    node.destroy_node()


def test_the_emulated_devices_lag_and_heat_themselves() -> None:
    sensors = LoggerSensors(np.array([0.0, 1800.0]), np.array([20.0, 50.0]), devices=3, seed=1)
    lines = [sensors.line(float(t)).split(',') for t in range(0, 4000, 10)]
    air = np.array([float(line[1]) for line in lines])
    device = np.array([[float(field) for field in line[3:]] for line in lines]).mean(axis=1)
    assert (device - air)[150] < -1.0
    assert (device - air)[-1] == pytest.approx(1.2, abs=0.6)


@pytest.mark.end_to_end
@pytest.mark.parametrize('wire', ['--tcp', '--link'])
def test_lines_arrive_over_a_real_port(wire: str, tmp_path) -> None:
    table = tmp_path / 'plan.csv'
    table.write_text('time_s,temperature_c\n0,20\n100,20\n')
    place = '0' if wire == '--tcp' else str(tmp_path / 'logger')
    code = 'import sys; from chamber_profile.emulators.reference_logger import main; main()'
    process = subprocess.Popen(
        [sys.executable, '-u', '-c', code, wire, place, '--temperature', str(table)],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    port = None
    try:
        address = re.search(r'at (\S+)', process.stdout.readline())[1]
        port = ReferenceLoggerPort(address, 9600)
        lines = ReferenceLines(parse_columns(['1=air', '5=device']))
        readings = []
        deadline = time.monotonic() + 20.0
        while len(readings) < 2 and time.monotonic() < deadline:
            readings += lines.feed(port.read())
        assert [reading['air'] for reading in readings] == pytest.approx([20.0, 20.0], abs=0.3)
    finally:
        if port is not None:
            port.close()
        process.terminate()
        process.communicate()
    assert process.returncode == 0


def test_tables_and_ports_that_are_none_are_refused(tmp_path) -> None:
    path = tmp_path / 'bad.csv'
    path.write_text('a,b\n1,2\n')
    with pytest.raises(ValueError, match='time_s,temperature_c'):
        read_table(path)
    with pytest.raises(ValueError, match='tcp://HOST:PORT'):
        ReferenceLoggerPort('/dev/ttyUSB0', 9600)
