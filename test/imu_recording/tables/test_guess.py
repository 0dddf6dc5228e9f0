# SPDX-License-Identifier: Apache-2.0
"""Mappings guessed from headers and ranges, and parts of files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from imu_recording.recording import BagError
from imu_recording.tables.csv_import import import_csv
from imu_recording.tables.guess import guess_mapping
from imu_recording.tables.row_range import row_range
from imu_recording.user_error import UserError

EXAMPLES = Path(__file__).resolve().parents[3] / 'examples'
HEADERS = {
    'SI': ('t', 's', 'ax,ay,az', 1.0, 'gx,gy,gz', 1.0, 'temp', 0.0),
    'g and degrees per second': (
        'Time (ms)', 'ms',
        'Acc X [g],Acc Y [g],Acc Z [g]', 1 / 9.80665,
        'gyro_x_dps,gyro_y_dps,gyro_z_dps', 180 / np.pi,
        'IMU temperature (K)', 273.15,
    ),
    'units alone tell, in another language': (
        'Zeitstempel [s]', 's',
        'Beschl X [mg],Beschl Y [mg],Beschl Z [mg]', 1000 / 9.80665,
        'Drehrate X [°/s],Drehrate Y [°/s],Drehrate Z [°/s]', 180 / np.pi,
        'Temperatur [°C]', 0.0,
    ),
    'seconds behind the name': (
        'time_s', 's',
        'ax[m/s^2],ay[m/s^2],az[m/s^2]', 1.0,
        'gx[rad/s],gy[rad/s],gz[rad/s]', 1.0,
        't_die[C]', 0.0,
    ),
    'mg by their norm': (
        'timestamp_us', 'us',
        'accelX,accelY,accelZ', 1000 / 9.80665,
        'imu.gyro.x,imu.gyro.y,imu.gyro.z', 1.0,
        'imu.temperature', 0.0,
    ),
}  # fmt: skip
PER_SECOND = {'s': 1.0, 'ms': 1e3, 'us': 1e6}


@pytest.mark.parametrize('name', HEADERS)
@pytest.mark.parametrize('delimiter', [',', ';', '\t'])
def test_what_is_guessed_reads_as_it_was_measured(
    name: str, delimiter: str, tmp_path: Path
) -> None:
    time_name, unit, forces, force, rates, rate, warmth, zero = HEADERS[name]
    rng = np.random.default_rng(3)
    n = 400
    time = 0.02 * np.arange(n)
    acceleration = [0.1, -0.2, 9.75] + rng.normal(0.0, 0.02, (n, 3))
    velocity = rng.normal(0.01, 0.002, (n, 3))
    temperature = 30.0 + 0.001 * np.arange(n)
    header = [time_name, *forces.split(','), *rates.split(','), warmth, 'status']
    columns = np.column_stack([
        time * PER_SECOND[unit], force * acceleration, rate * velocity, temperature + zero,
        np.zeros(n),
    ])  # fmt: skip
    path = tmp_path / 'board.csv'
    lines = [delimiter.join(header), *(delimiter.join(map(repr, r)) for r in columns.tolist())]
    path.write_text('\n'.join(lines))
    guess = guess_mapping(path)
    recording = import_csv(path, guess.mapping)
    np.testing.assert_allclose(recording.time, time, atol=1e-6)
    np.testing.assert_allclose(recording.linear_acceleration, acceleration, rtol=1e-6)
    np.testing.assert_allclose(recording.angular_velocity, velocity, rtol=1e-6)
    np.testing.assert_allclose(recording.temperature, temperature, rtol=1e-6)
    assert any('not used: status' in question for question in guess.unsure)
    assert yaml.safe_load(yaml.safe_dump(guess.mapping)) == guess.mapping


@pytest.mark.shared_data
def test_public_files_need_the_mapping_of_the_examples(shared: Path) -> None:
    told = yaml.safe_load((EXAMPLES / 'tofupilot_mapping.yaml').read_text())
    guess = guess_mapping(shared / 'data' / 'tofupilot_chamber' / 'imu_raw_data.csv')
    for key in ('time', 'columns', 'delimiter'):
        assert guess.mapping[key] == told[key]
    told = yaml.safe_load((EXAMPLES / 'freeimu_mapping.yaml').read_text())
    guess = guess_mapping(shared / 'data' / 'freeimu_freezer' / 'Tempdata01-02-14.csv')
    forces = 'linear_acceleration'
    assert guess.mapping['time'] == told['time']
    assert guess.mapping['columns'][forces] == told['columns'][forces]
    for said in ('angular_velocity: whole numbers', 'dTemp is about', 'that of no unit'):
        assert any(said in question for question in guess.unsure), said


def resting(path: Path, header: str, *, encoding: str = 'utf-8', comma: bool = False) -> Path:
    """A board at rest in g and °/s, 77 … 86 °F; no column but those of `header` says its unit."""
    rng = np.random.default_rng(4)
    time = 0.2 * np.arange(600)
    force = [0.0, 0.0, 1.0] + 0.002 * rng.normal(size=(600, 3))
    rate = 0.5 + 0.05 * rng.normal(size=(600, 3))
    rows = np.column_stack([time, force, rate, 77.0 + 0.075 * time])
    lines = [','.join(f'{value:.6f}' for value in row) for row in rows]
    if comma:
        lines = [line.replace(',', ';').replace('.', ',') for line in lines]
        header = header.replace(',', ';')
    path.write_text('\n'.join([header, *lines]), encoding=encoding)
    return path


def test_comments_above_the_header_are_left_out(tmp_path: Path) -> None:
    path = resting(
        tmp_path / 'a.csv', '# board A7\n"time", "ax", "ay", "az", "gx", "gy", "gz", "T"'
    )
    guess = guess_mapping(path)
    assert guess.mapping['comment'] == '#'
    assert len(import_csv(path, guess.mapping)) == 600


def test_unix_times_are_told_by_their_size(tmp_path: Path) -> None:
    path = tmp_path / 'a.csv'
    rows = (f'{1.7e9 + k + 86400 * (k > 50):.3f},0,0,9.8,{20 + k / 100}' for k in range(100))
    path.write_text('\n'.join(['unix_time,ax,ay,az,temp', *rows]))
    assert guess_mapping(path).mapping['time'] == {'column': 'unix_time', 'unit': 's'}


def test_rates_that_would_be_too_loud_are_degrees(tmp_path: Path) -> None:
    path = resting(tmp_path / 'a.csv', 'time,ax,ay,az,gx,gy,gz,temp')
    guess = guess_mapping(path)
    assert guess.mapping['columns']['angular_velocity']['unit'] == '°/s'
    said = '; '.join(guess.unsure)
    assert 'taken as °/s; in rad/s: ' in said
    assert 'temp is about 81.5, taken as °C: or is it °F?' in said
    assert np.abs(import_csv(path, guess.mapping).angular_velocity).max() < 0.02


def test_a_unit_behind_the_name_of_a_temperature(tmp_path: Path) -> None:
    guess = guess_mapping(resting(tmp_path / 'a.csv', 'time,ax,ay,az,gx,gy,gz,temp_degF'))
    assert guess.mapping['columns']['temperature'] == {'column': 'temp_degF', 'unit': 'degF'}


def test_channels_beside_the_sensors(tmp_path: Path) -> None:
    path = tmp_path / 'a.csv'
    lines = (f'{k / 50},0,0,9.8,31,30,30.5,{995 + k % 3},{k % 2},40' for k in range(100))
    header = 't,ax,ay,az,temp,chamber_temp,chamber_temp_2,baro_press,compressor,fan_duty'
    path.write_text('\n'.join([header, *lines]))
    guess = guess_mapping(path)
    found = {name: entry.get('unit') for name, entry in guess.mapping['columns'].items()}
    del found['linear_acceleration']
    assert found == {
        'temperature': '°C',
        'chamber_temperature': '°C',
        'chamber_temperature_2': '°C',
        'pressure': 'hPa',
        'compressor': '1',
        'fan': '%',
    }
    assert not any('not used' in question for question in guess.unsure)


def test_decimal_commas_and_windows_characters(tmp_path: Path) -> None:
    header = 'Zeit,ax,ay,az,gx,gy,gz,Temp (°F)'
    path = resting(tmp_path / 'a.csv', header, encoding='cp1252', comma=True)
    guess = guess_mapping(path)
    assert guess.mapping['delimiter'] == ';'
    assert guess.mapping['decimal'] == ','
    recording = import_csv(path, guess.mapping)
    assert recording.time[-1] == pytest.approx(119.8)
    assert recording.temperature[0] == pytest.approx(25.0)


def test_columns_without_a_number_are_said(tmp_path: Path) -> None:
    path = tmp_path / 'a.csv'
    path.write_text('t,ax,ay,az\n0,x,y,z\n1,x,y,z\n')
    assert 'linear_acceleration: no cell of 2 lines is a number' in guess_mapping(path).unsure


BAD = {
    'no header': ('1,2,3\n4,5,6\n', 'no header'),
    'nothing': ('', 'is empty'),
    'no vector': ('time,pressure\n1,2\n', 'no columns such as'),
    'no time': ('ax,ay,az\n0,0,9.8\n', 'no column looks like the time'),
    'twice the same': ('t,ax,ax,az\n0,0,0,9.8\n', 'the same name'),
    'no data': ('t,ax,ay,az\n', 'as many cells as its header'),
}


@pytest.mark.parametrize('name', BAD)
def test_what_cannot_be_guessed_asks_for_a_mapping(name: str, tmp_path: Path) -> None:
    text, reason = BAD[name]
    path = tmp_path / 'board.csv'
    path.write_text(text)
    with pytest.raises(BagError, match=reason):
        guess_mapping(path)


@pytest.fixture
def numbered(tmp_path: Path) -> Path:
    """A sample a second; line k + 2 holds second k."""
    path = tmp_path / 'numbered.csv'
    rows = [f'{k},0.0,0.0,{9.8 + 0.001 * k}' for k in range(100)]
    path.write_text('\n'.join(['t,ax,ay,az', *rows]))
    return path


@pytest.mark.parametrize(
    ('first', 'last', 'seconds'),
    [
        ('12', '20', range(10, 19)),
        (None, '20', range(19)),
        ('90s', None, range(90, 100)),
        ('0.5min', '31s', range(30, 32)),
        ('11', '5s', range(9, 15)),  # five seconds from the first line that is read
    ],
)
def test_a_part_of_a_file(
    numbered: Path, first: str | None, last: str | None, seconds: range
) -> None:
    mapping = guess_mapping(numbered).mapping
    mapping['time']['unit'] = 's'
    recording = import_csv(numbered, mapping, row_range(first, last))
    found = (recording.linear_acceleration[:, 2] - 9.8) * 1000.0
    assert np.rint(found).tolist() == list(seconds)


def test_limits_that_leave_nothing_are_refused(numbered: Path) -> None:
    mapping = guess_mapping(numbered).mapping
    for first, last in (('500', None), ('3h', None)):
        with pytest.raises(BagError, match='no row'):
            import_csv(numbered, mapping, row_range(first, last))
    for first, last, said in (('9', '3', 'after the end'), ('3 days', None, 'expected a line')):
        with pytest.raises(UserError, match=said):
            row_range(first, last)


ROWS = [f'{k},0.1,0.2,9.8,0.001,0.002,0.003,2{k % 9}.5' for k in range(200)]
HEADER = 't,ax,ay,az,gx,gy,gz,temp'


WORDS = [f'{200 + k},err,1,9.8,0,0,0,25' for k in range(5)]

NO_TABLES = {
    'empty': ('', 'the file is empty'),
    'header alone': (HEADER, 'no line follows it'),
    'decimal commas': (
        '\n'.join([HEADER, *(row.replace('.', ',') for row in ROWS)]),
        'most have 15: decimal commas',
    ),
    'a picture': ('\x89PNG,\x1a\n\0,\r', 'is no text'),
    'a clock that stands': (
        '\n'.join([HEADER, *(f'0,{row.partition(",")[2]}' for row in ROWS)]),
        "'t' holds the same time",
    ),
    'a year beyond': ('\n'.join([HEADER, *ROWS, '1e300,1e300,1,1,1,1,1,1']), '1e+300 ms is no'),
    'words': ('\n'.join([HEADER, *ROWS, *WORDS]), "'err' is no number; corr"),
}


@pytest.mark.parametrize(('content', 'told'), NO_TABLES.values(), ids=NO_TABLES)
def test_what_is_no_table_is_told_in_a_line(
    content: str, told: str, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    path = tmp_path / 'a.csv'
    path.write_bytes(content.encode())
    with pytest.raises(BagError) as refused:
        import_csv(path, guess_mapping(path).mapping)
    assert told in str(refused.value)
    assert '\n' not in str(refused.value)
    assert not recwarn.list


def test_utf16_is_read_and_said(tmp_path: Path) -> None:
    path = tmp_path / 'a.csv'
    path.write_text('\n'.join([HEADER, *ROWS]), 'utf-16')
    recording = import_csv(path, guess_mapping(path).mapping)
    assert len(recording) == 200
    assert 'the file is read as UTF-16' in recording.notes


def test_exchanged_columns_of_force_and_rate_are_asked_about(tmp_path: Path) -> None:
    path = tmp_path / 'exchanged.csv'
    rows = '\n'.join(f'{0.1 * k:.1f},0.01,0.0,0.02,0.1,0.1,9.8,21.0' for k in range(20))
    path.write_text(f'time,ax,ay,az,gx,gy,gz,temperature\n{rows}\n')
    said = guess_mapping(path).unsure
    assert any('angular_velocity: its norm, 9.801, is gravity' in question for question in said)
