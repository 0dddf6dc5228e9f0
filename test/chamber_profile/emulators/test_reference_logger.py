# SPDX-License-Identifier: Apache-2.0
"""The emulated data logger: its sensors, and its lines over a real port."""

import re
import subprocess
import sys
import time

import numpy as np
import pytest
from chamber_profile.emulators.reference_logger import LoggerSensors, read_table
from chamber_profile.reference.logger import ReferenceLines, ReferenceLoggerPort, parse_columns


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
        deadline = time.monotonic() + 120.0
        while len(readings) < 2 and time.monotonic() < deadline:
            readings += lines.feed(port.read())
        assert [reading['air'] for reading in readings] == pytest.approx([20.0, 20.0], abs=0.3)
    finally:
        if port is not None:
            port.close()
        process.terminate()
        process.communicate()
    assert process.returncode == 0


def test_a_table_that_is_none_is_refused(tmp_path) -> None:
    path = tmp_path / 'bad.csv'
    path.write_text('a,b\n1,2\n')
    with pytest.raises(ValueError, match='time_s,temperature_c'):
        read_table(path)
