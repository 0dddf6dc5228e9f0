# SPDX-License-Identifier: Apache-2.0
"""CSV files become recordings by their mapping; what is wrong is named with its place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_recording.logging_contract import CHANNEL_FIELDS
from imu_recording.recording import STANDARD_GRAVITY, BagError
from imu_recording.tables.csv_import import import_csv
from imu_recording.tables.mapping import MappingError, mapping_from
from imu_recording.tables.row_range import RowRange
from recording_samples import assert_same

from imu_recording import read_bag, write_bag

EXAMPLES = Path(__file__).parents[3] / 'examples'
MAPPING: dict[str, Any] = {
    'schema': 1,
    'device': 'board',
    'time': {'column': 't', 'unit': 'ms'},
    'columns': {
        'linear_acceleration': {'columns': ['ax', 'ay', 'az'], 'unit': 'g'},
        'angular_velocity': {'columns': ['gx', '-gy', 'gz'], 'scale': '1/4', 'unit': 'deg/s'},
        'temperature': {'column': 'T', 'scale': 0.5, 'offset': [32], 'unit': '°F'},
    },
}
HEADER = 't,ax,ay,az,gx,gy,gz,T\n'


def written(path: Path, rows: str, header: str = HEADER) -> Path:
    path.write_text(header + rows)
    return path


@pytest.mark.shared_data
def test_freeimu_log_becomes_a_bag(shared: Path, tmp_path: Path) -> None:
    source = shared / 'data' / 'freeimu_freezer' / 'Tempdata01-02-14.csv'
    recording = import_csv(source, EXAMPLES / 'freeimu_mapping.yaml')
    raw = np.loadtxt(source, delimiter=',', skiprows=1)
    order = np.argsort(raw[:, 12], kind='stable')
    first = np.concatenate(([True], np.diff(raw[order, 12]) > 0))
    raw = raw[order][first]
    assert np.array_equal(recording.stamp, raw[:, 12].astype(int) * 1_000_000)
    np.testing.assert_allclose(recording.linear_acceleration, raw[:, :3] / 16384 * 9.80665)
    np.testing.assert_allclose(recording.angular_velocity, np.deg2rad(raw[:, 3:6] / 16.4))
    np.testing.assert_allclose(recording.magnetic_field, raw[:, 6:9] / 1090 * 1e-4)
    np.testing.assert_allclose(recording.temperature, raw[:, 9] / 340 + 36.53)
    assert recording.temperature.min() == pytest.approx(10.4, abs=0.05)
    assert recording.temperature.max() == pytest.approx(28.9, abs=0.05)
    assert 2100 < recording.time[-1] < 2200
    assert any('gaps above three periods, the longest 2.8' in note for note in recording.notes)
    write_bag(recording, tmp_path / 'freeimu')
    assert_same(recording, read_bag(tmp_path / 'freeimu'))


def test_units_signs_and_offsets(tmp_path: Path) -> None:
    file = written(tmp_path / 'a.csv', '0,0,0,1,4,8,-4,0\n10,0,0,1,4,8,-4,360\n')
    recording = import_csv(file, MAPPING)
    assert recording.stamp.tolist() == [0, 10_000_000]
    assert recording.linear_acceleration[0].tolist() == [0, 0, 9.80665]
    np.testing.assert_allclose(recording.angular_velocity[1], np.deg2rad([1, -2, -1]))
    np.testing.assert_allclose(recording.temperature, [0, 100])
    assert np.isnan(recording.magnetic_field).all()
    assert (recording.device, recording.up_axis) == ('board', '+z')


def test_a_tab_separated_log_in_si_units_that_lies_on_its_back(tmp_path: Path) -> None:
    header = 'timestamp\timu.gyro.x\timu.gyro.y\timu.gyro.z\timu.acc.x\timu.acc.y\timu.acc.z'
    rows = [
        f'{256551281491968 + 505630 * k}\t-0.047\t0.0156\t0.0226\t0.178\t-0.107\t-9.55\t0\t{t}'
        for k, t in enumerate((51.615, 52.106, 52.089))
    ]
    file = written(
        tmp_path / 'imu.csv', '\n'.join(rows), f'{header}\timu.status\timu.temperature\n'
    )
    recording = import_csv(file, EXAMPLES / 'tofupilot_mapping.yaml')
    assert (recording.device, recording.up_axis) == ('tofupilot', '-z')
    np.testing.assert_allclose(recording.time, [0.0, 0.50563, 1.01126])
    np.testing.assert_array_equal(recording.angular_velocity, [[-0.047, 0.0156, 0.0226]] * 3)
    np.testing.assert_array_equal(recording.linear_acceleration, [[0.178, -0.107, -9.55]] * 3)
    np.testing.assert_array_equal(recording.temperature, [51.615, 52.106, 52.089])
    assert np.isnan(recording.magnetic_field).all()


def test_missing_values_gaps_and_times_out_of_order(tmp_path: Path) -> None:
    rows = [f'{t},0,0,1,0,0,0,20' for t in (0, 10, 30, 20, 20, 40, 50, 900)]
    rows[1] = '10,,nan,1,inf,0,0,20'
    rows += ['# end', 'nan,0,0,1,0,0,0,20', '', '910,0,0']
    mapping = MAPPING | {'comment': '#'}
    recording = import_csv(written(tmp_path / 'a.csv', '\n'.join(rows)), mapping)
    assert (recording.stamp // 1_000_000).tolist() == [0, 10, 20, 30, 40, 50, 900]
    assert np.isnan(recording.linear_acceleration[1]).tolist() == [True, True, False]
    assert np.isnan(recording.angular_velocity[1, 0])
    for said in (
        '1 lines do not have 8 cells and are left out (first: line 13)',
        '1 rows without a time left out',
        'rows: stamps stepped back 1 times; sorted by stamp',
        'rows: 1 samples with a repeated stamp left out',
        '1 gaps above three periods, the longest 0.85 s',
        'linear_acceleration: 1 of 7 rows are missing or not finite, NaN',
        'no columns for magnetic_field: it is NaN',
    ):
        assert said in recording.notes


def test_semicolons_decimal_commas_dates_and_no_header(tmp_path: Path) -> None:
    mapping = {
        'schema': 1,
        'delimiter': ';',
        'decimal': ',',
        'header': False,
        'time': {'column': 0, 'unit': 'iso8601'},
        'columns': {'magnetic_field': {'columns': [1, 2, 3], 'unit': 'µT'}},
    }
    file = written(
        tmp_path / 'a.csv',
        '2014-01-02T12:00:00.5;1,5;2;-40\n2014-01-02 13:00:01+01:00;2,5;n/a;-40\n',
        header='',
    )
    recording = import_csv(file, mapping)
    assert np.diff(recording.stamp).tolist() == [500_000_000]
    assert recording.stamp[0] == 1_388_664_000_500_000_000
    np.testing.assert_allclose(recording.magnetic_field[:, 0], [1.5e-6, 2.5e-6])


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'the file is empty'),
        (HEADER, "no row with a time in column 't'"),
        (HEADER + '0,0,0,1,0,0,0,20\n1,0,x,1,0,0,0,20\n', "line 3, column 'ay': 'x' is no number"),
        ('t,ax\n0,1\n', "no column 'ay'; it has t, ax"),
        (HEADER + '1e300,0,0,1,0,0,0,20\n', 'is its unit right'),
    ],
)
def test_files_that_do_not_fit(tmp_path: Path, text: str, said: str) -> None:
    file = written(tmp_path / 'a.csv', text, header='')
    with pytest.raises(BagError) as raised:
        import_csv(file, MAPPING)
    assert said in str(raised.value)
    assert str(file) in str(raised.value)


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'schema': 2}, 'schema is 2, expected 1'),
        ({'tme': 1}, "unknown key 'tme'"),
        ({'time': {'unit': 's'}}, 'time: expected a column'),
        ({'time': {'column': 't', 'unit': 'fortnight'}}, "unit is 'fortnight'"),
        ({'up_axis': 'z'}, "up_axis is 'z'"),
        ({'delimiter': ';;'}, 'expected a single character'),
        ({'columns': {}}, 'expected at least one of'),
        ({'columns': {'humidity': {'column': 'h'}}}, 'expected at least one of angular_velocity'),
        ({'columns': {'speed': {}}}, "unknown key 'speed'"),
        ({'columns': {'magnetic_field': {'columns': ['a', 'b']}}}, 'expected 3 columns'),
        ({'columns': {'magnetic_field': {'column': 'a'}}}, "unknown key 'column'|the key columns"),
        (
            {'columns': {'magnetic_field': {'columns': ['a'] * 3, 'unit': 'V'}}},
            "unit is 'V', expected one of T, mT",
        ),
        (
            {'columns': {'magnetic_field': {'columns': ['a'] * 3, 'scale': [1, 2]}}},
            'scale has 2 numbers, expected 3',
        ),
        (
            {'columns': {'magnetic_field': {'columns': ['a'] * 3, 'scale': '1/0'}}},
            "scale is '1/0', expected a number or a fraction",
        ),
    ],
)
def test_mappings_that_are_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(MappingError, match=said):
        mapping_from(MAPPING | change)


def test_mapping_files_that_are_refused(tmp_path: Path) -> None:
    file = written(tmp_path / 'a.csv', '0,0,0,1,0,0,0,20\n')
    with pytest.raises(MappingError, match='cannot be read'):
        import_csv(file, tmp_path / 'missing.yaml')
    (tmp_path / 'bad.yaml').write_text('a: [')
    with pytest.raises(MappingError, match='not a YAML file'):
        import_csv(file, tmp_path / 'bad.yaml')
    with pytest.raises(BagError, match='No such file'):
        import_csv(tmp_path / 'missing.csv', MAPPING)


@pytest.mark.parametrize(
    ('field', 'spelling', 'factor'),
    [
        ('angular_velocity', 'dps', np.pi / 180),
        ('angular_velocity', 'Deg/s', np.pi / 180),
        ('linear_acceleration', 'G', 9.80665),
        ('linear_acceleration', 'mg', 9.80665e-3),
        ('magnetic_field', 'Gauss', 1e-4),
        ('magnetic_field', 'μT', 1e-6),
        ('temperature', 'degF', 5 / 9),
        ('temperature', 'degC', 1.0),
    ],
)
def test_units_as_drivers_write_them(field: str, spelling: str, factor: float) -> None:
    names = {'column': 'T'} if field == 'temperature' else {'columns': ['a', 'b', 'c']}
    columns = {'linear_acceleration': {'columns': ['a', 'b', 'c']}} | {
        field: {**names, 'unit': spelling}
    }
    found = mapping_from({'schema': 1, 'time': {'column': 't'}, 'columns': columns})
    assert next(c for c in found.columns if c.field == field).factor == pytest.approx(factor)


@pytest.mark.parametrize(
    ('text', 'changes', 'way_out'),
    [
        ('t;a;b;c\n0;0;0;1\n', {}, "is the delimiter ';'?"),
        ('t;a;b;c\n0;0;0;1,5\n', {'delimiter': ';'}, "is the decimal sign a comma? (decimal: ','"),
        (
            't,a,b,c\n07.03.2024 12:00,0,0,1\n',
            {'time': {'column': 't', 'unit': 'iso8601'}},
            'write dates as 2024-03-07T12:00:00',
        ),
        ('t,ax,b,c\n0,0,0,1\n', {}, "no column 'a' (did you mean"),
    ],
)
def test_a_refusal_says_the_way_out(
    tmp_path: Path, text: str, changes: dict[str, Any], way_out: str
) -> None:
    file = tmp_path / 'a.csv'
    file.write_text(text)
    columns = {'linear_acceleration': {'columns': ['a', 'b', 'c'], 'unit': 'g'}}
    mapping = {'schema': 1, 'time': {'column': 't'}, 'columns': columns, **changes}
    with pytest.raises(BagError) as refused:
        import_csv(file, mapping)
    assert way_out in str(refused.value)


def test_zones_and_encodings_that_are_assumed_are_told(tmp_path: Path) -> None:
    file = tmp_path / 'a.csv'
    columns = {
        'linear_acceleration': {'columns': ['a', 'b', 'c']},
        'temperature': {'column': '°C'},
    }
    mapping = {
        'schema': 1,
        'time': {'column': 't', 'unit': 'iso8601'},
        'columns': columns,
    }
    rows = '2024-03-07T12:00:00{0},0,0,9.8,20\n2024-03-07T12:00:01{0},0,0,9.8,21\n'
    file.write_bytes(('t,a,b,c,°C\n' + rows.format('')).encode('cp1252'))
    naive = import_csv(file, mapping)
    assert 'the times name no zone: taken as UTC' in naive.notes
    assert any('Windows-1252' in note for note in naive.notes)
    file.write_text('t,a,b,c,°C\n' + rows.format('+01:00'))
    zoned = import_csv(file, mapping)
    assert not any('zone' in note for note in zoned.notes)
    assert naive.stamp[0] - zoned.stamp[0] == 3_600_000_000_000


def test_a_minus_of_the_header_itself_is_no_sign(tmp_path: Path) -> None:
    file = tmp_path / 'a.csv'
    file.write_text('t,ax,ay,-az\n0,0,0,9.8\n1,0,0,9.8\n')
    columns = {'linear_acceleration': {'columns': ['ax', '-ay', '-az']}}
    found = import_csv(file, {'schema': 1, 'time': {'column': 't'}, 'columns': columns})
    assert found.linear_acceleration[0].tolist() == [0.0, 0.0, 9.8]


CHAMBER: dict[str, Any] = {
    'schema': 1,
    'time': {'column': 'date', 'unit': 'iso8601'},
    'columns': {
        'chamber_temperature': {'column': 'air', 'unit': '°C'},
        'setpoint': {'column': 'sp', 'unit': '°C'},
    },
}
NOON = 1_709_812_800  # 2024-03-07T12:00:00Z


def board_and_chamber(folder: Path) -> tuple[Path, Path]:
    """A board that counts 60 s from noon, and a chamber that wrote local time every 5 s."""
    board = written(folder / 'a.csv', ''.join(f'{10 * k},0,0,1,4,8,-4,60\n' for k in range(6000)))
    lines = (f'2024-03-07T13:00:{s:02d},{20 + s},{30 + s // 30}\n' for s in range(10, 41, 5))
    return board, written(folder / 'chamber.csv', ''.join(lines), 'date,air,sp\n')


def of_time(mapping: dict[str, Any], **keys: Any) -> dict[str, Any]:
    return {**mapping, 'time': {**mapping['time'], **keys}}


def test_the_log_of_a_chamber_is_joined_by_time(tmp_path: Path) -> None:
    board, chamber = board_and_chamber(tmp_path)
    recording = import_csv(
        board,
        of_time(MAPPING, start='2024-03-07T12:00:00Z'),
        beside=[(chamber, of_time(CHAMBER, zone='+01:00'))],
    )
    assert recording.stamp[0] == NOON * 10**9
    air = recording.chamber_temperature
    assert air is not None
    assert np.isnan(air[:1000]).all()
    assert air[[1000, 1499, 1500, 3999, 4000]].tolist() == [30.0, 30.0, 35.0, 55.0, 60.0]
    assert recording.phase is not None
    notes = '\n'.join(recording.notes)
    assert 'chamber.csv: 7 samples joined by time, the first 10.000 s after the first' in notes
    assert 'UTC' not in notes  # the zone is said
    assert 'chamber.csv, chamber_temperature: 1000 rows without a sample of the time' in notes
    (late,) = (
        import_csv(
            board,
            of_time(MAPPING, start='2024-03-07T12:00:00Z', offset=2.0),
            beside=[(chamber, of_time(CHAMBER, zone=60))],  # what YAML makes of +1:00
        ),
    )
    assert late.chamber_temperature is not None
    assert late.chamber_temperature[800] == 30.0


def test_any_channel_of_the_logging_contract(tmp_path: Path) -> None:
    units = {'humidity': '%', 'pressure': 'hPa', 'chamber_temperature_2': 'K'}
    scalars = [name for name in CHANNEL_FIELDS if name != 'vibration']
    columns: dict[str, Any] = {name: {'column': name, 'unit': units.get(name)} for name in scalars}
    columns['linear_acceleration'] = {'columns': ['a', 'a', 'a']}
    columns['vibration'] = {'columns': ['vx', 'vy', 'vz'], 'unit': 'g²'}
    header = ','.join(['t,a,vx,vy,vz', *scalars]) + '\n'
    rows = ''.join(f'{k},1,1,2,4{",300" * len(scalars)}\n' for k in range(3))
    file = written(tmp_path / 'a.csv', rows, header)
    found = import_csv(file, {'schema': 1, 'time': {'column': 't'}, 'columns': columns})
    for name in CHANNEL_FIELDS:
        assert getattr(found, name) is not None, name
    assert found.pressure is not None
    assert found.pressure.tolist() == [30_000.0] * 3
    assert found.chamber_temperature_2 == pytest.approx(np.full(3, 26.85))
    assert found.vibration is not None
    assert found.vibration[0] / STANDARD_GRAVITY**2 == pytest.approx([1.0, 2.0, 4.0])


def test_a_log_that_ends_is_not_held_for_ever(tmp_path: Path) -> None:
    board, chamber = board_and_chamber(tmp_path)
    lines = chamber.read_text().splitlines()[:3]
    chamber.write_text('\n'.join([*lines, '']))  # samples at 10 and 15 s
    recording = import_csv(
        board, of_time(MAPPING, start='2024-03-07T13:00:00'), beside=[(chamber, CHAMBER)]
    )
    air = recording.chamber_temperature
    assert air is not None
    assert air[5999] == 35.0  # 45 s after the last, of 5 s
    lines[2] = '2024-03-07T13:00:10.5,21,30'
    chamber.write_text('\n'.join([*lines, '']))
    recording = import_csv(
        board, of_time(MAPPING, start='2024-03-07T13:00:00'), beside=[(chamber, CHAMBER)]
    )
    air = recording.chamber_temperature
    assert air is not None
    assert air[1550] == 21.0
    assert np.isnan(air[1551:]).all()


def test_clocks_that_do_not_meet_are_refused_with_the_way_out(tmp_path: Path) -> None:
    board, chamber = board_and_chamber(tmp_path)
    with pytest.raises(BagError, match=r'0\.000 s to 59\.990 s; say the difference') as refused:
        import_csv(board, MAPPING, beside=[(chamber, CHAMBER)])
    assert '2024-03-07T13:00:10+00:00' in str(refused.value)
    both = {**CHAMBER['columns'], 'temperature': {'column': 'air'}}
    with pytest.raises(BagError, match=r'temperature is in .*chamber\.csv and in another file'):
        import_csv(
            board,
            of_time(MAPPING, start='2024-03-07T13:00:00'),
            beside=[(chamber, {**CHAMBER, 'columns': both})],
        )


@pytest.mark.parametrize(
    ('keys', 'said'),
    [
        ({'unit': 's', 'zone': '+01:00'}, 'zone is of dates'),
        ({'unit': 'iso8601', 'zone': 'Berlin'}, "zone is 'Berlin', expected"),
        ({'unit': 'iso8601', 'start': '2024-03-07'}, 'start is of a clock that counts'),
        ({'unit': 's', 'start': 'noon'}, "start is 'noon', expected a date"),
        ({'unit': 's', 'offset': 'late'}, "offset is 'late', expected a number"),
    ],
)
def test_a_wrong_clock_is_named(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(MappingError, match=said):
        mapping_from(of_time(MAPPING, **keys))


def test_gyroscope_and_magnetometer_in_files_of_their_own(tmp_path: Path) -> None:
    """Phones write a file per sensor."""
    names = {'a': 'linear_acceleration', 'g': 'angular_velocity', 'm': 'magnetic_field'}
    units = {'a': 'm/s²', 'g': 'rad/s', 'm': 'µT'}
    files, mappings = [], []
    for key, field in names.items():
        columns = [f'{key}{axis}' for axis in 'xyz']
        late = 0.005 if key == 'g' else 0.0
        rows = ''.join(f'{0.02 * k + late:.3f},{k},1,2\n' for k in range(100))
        files.append(written(tmp_path / f'{key}.csv', rows, f't,{",".join(columns)}\n'))
        mappings.append(
            {
                'schema': 1,
                'time': {'column': 't', 'unit': 's'},
                'columns': {field: {'columns': columns, 'unit': units[key]}},
            }
        )
    beside = list(zip(files[1:], mappings[1:], strict=True))
    recording = import_csv(files[0], mappings[0], beside=beside)
    assert recording.linear_acceleration[:, 0].tolist() == list(range(100))
    np.testing.assert_allclose(recording.angular_velocity[1:, 0], np.arange(99) + 0.75)
    assert np.isnan(recording.angular_velocity[0]).all()
    np.testing.assert_allclose(recording.magnetic_field[:, 0], 1e-6 * np.arange(100))


def test_rows_of_a_clock_that_was_set_back_are_counted_with_the_way_out(tmp_path: Path) -> None:
    times = [*np.arange(1.0, 9.0, 0.5), *np.arange(1.0, 5.0, 0.5)]
    text = '\n'.join(f'{t:.2f},0,0,9.81,20' for t in times)
    path = written(tmp_path / 'restarted.csv', text, 't,ax,ay,az,temp\n')
    mapping = {
        'schema': 1,
        'device': 'a',
        'time': {'column': 't', 'unit': 's'},
        'columns': {'linear_acceleration': {'columns': ['ax', 'ay', 'az'], 'unit': 'm/s²'}},
    }
    whole = import_csv(path, mapping)
    assert len(whole) == 16
    assert any('8 samples of times' in n and 'another --from' in n for n in whole.notes)
    second = import_csv(path, mapping, RowRange(first_line=18))
    assert len(second) == 8
    assert 'rows before --from and after --to were not read' in second.notes
    assert not any('set back' in note for note in second.notes)


def test_a_channel_that_stands_in_few_rows_is_held_until_the_next(tmp_path: Path) -> None:
    file = tmp_path / 'sparse.csv'
    cells = [f'{20 + k // 50}' if k % 50 == 0 else '' for k in range(500)]
    cells[300:] = [''] * 200
    rows = [f'{10 * k},0,0,1,1,2,3,{cell}' for k, cell in enumerate(cells)]
    file.write_text('\n'.join(['t,ax,ay,az,gx,gy,gz,T', *rows]), 'utf-8')
    columns = MAPPING['columns'] | {'temperature': {'column': 'T', 'unit': '°C'}}
    recording = import_csv(file, MAPPING | {'columns': columns})
    assert recording.temperature[[0, 49, 50, 299]].tolist() == [20, 20, 21, 25]
    assert recording.temperature_stamp is not None
    assert recording.temperature_stamp[[49, 50]].tolist() == [0, 500_000_000]
    assert 'temperature: 6 of 500 rows hold a value, each until the next' in recording.notes
