# SPDX-License-Identifier: Apache-2.0
"""The verb `import`: logs of autopilots become bags that the other verbs take."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from imu_workbench.__main__ import main
from thermal_comp.model.file import load_model

from imu_recording import read_bag


@pytest.mark.parametrize('suffix', [pytest.param('ulg', marks=pytest.mark.long), 'bin'])
def test_a_log_of_the_simulated_device_gives_its_model(
    suffix: str, writers: ModuleType, bags: Path, tmp_path: Path
) -> None:
    """What is fitted to the imported log is what is fitted to the bag it was written from."""
    bag = read_bag(bags / 'dut1_z')
    write = writers.ulog_bytes if suffix == 'ulg' else writers.dataflash_bytes
    log, told = tmp_path / f'chamber.{suffix}', tmp_path / 'told.json'
    log.write_bytes(write([bag]))
    command = ['import', str(log), '-o', str(tmp_path / 'bags'), '--json', str(told)]
    assert main(command) == 0
    content = json.loads(told.read_text())
    assert [item['samples'] for item in content['bags']] == [len(bag)]
    metadata = yaml.safe_load((tmp_path / 'bags' / 'imu0' / 'metadata.yaml').read_text())
    custom = metadata['rosbag2_bagfile_information']['custom_data']
    assert json.loads(custom['log_hardware']) == content['bags'][0]['hardware']
    models = []
    for name, source in (('log', tmp_path / 'bags' / 'imu0'), ('bag', bags / 'dut1_z')):
        target = tmp_path / f'{name}.yaml'
        assert main(['fit', str(source), '-o', str(target)]) == 0
        models.append(load_model(target))
    for sensor, part in models[1].sensors.items():
        found = models[0].sensors[sensor].coefficients[0]
        assert found == pytest.approx(part.coefficients[0], rel=0.02, abs=1e-6), sensor


def test_nothing_is_replaced_and_no_file_is_guessed(
    writers: ModuleType, bags: Path, tmp_path: Path, capsys
) -> None:
    log = tmp_path / 'flight.ulg'
    log.write_bytes(writers.ulog_bytes([read_bag(bags / 'dut1_z').rows(slice(0, 300))]))
    command = ['import', str(log), '-o', str(tmp_path / 'bags')]
    assert main(command) == 0
    assert main(command) == 2
    assert 'imu0 exists already' in capsys.readouterr().err
    assert main([*command, '--force']) == 0
    assert main([*command, '--force', '--mapping', 'x.yaml']) == 2
    assert 'which needs none' in capsys.readouterr().err
    assert main(['import', str(tmp_path / 'none.ulg'), '-o', 'x']) == 2
    assert 'none.ulg: no such file' in capsys.readouterr().err


@pytest.mark.shared_data
def test_real_log(shared: Path, tmp_path: Path) -> None:
    log = shared / 'data' / 'px4_logs' / 'pyulog_sample_log_small.ulg'
    assert main(['import', str(log), '-o', str(tmp_path / 'px4')]) == 0
    assert sorted(path.name for path in (tmp_path / 'px4').iterdir()) == ['imu0', 'imu1', 'imu2']


def test_a_guess_is_shown_and_taken_with_yes(tmp_path: Path, capsys) -> None:
    path, told = tmp_path / 'board.csv', tmp_path / 'told.json'
    rows = (f'{0.02 * k:.2f},0.1,0.2,9.8,0.01,0.02,0.03,{30 + 0.01 * k}' for k in range(500))
    path.write_text('\n'.join(['time,ax,ay,az,gx,gy,gz,temp', *rows]))
    assert main(['import', str(path), '--json', str(told)]) == 0
    shown = capsys.readouterr().out
    assert '# unsure: angular_velocity: no unit in the header, taken as rad/s' in shown
    assert yaml.safe_load(shown) == json.loads(told.read_text())['mapping']
    assert main(['import', str(path), '--yes']) == 2
    assert '-o DIR is missing' in capsys.readouterr().err
    command = ['import', str(path), '--yes', '--from', '2s', '-o', str(tmp_path / 'bag')]
    assert main(command) == 0
    assert 'note: the mapping is a guess' in capsys.readouterr().out
    assert len(read_bag(tmp_path / 'bag')) == 400


def test_a_part_of_a_log(writers: ModuleType, bags: Path, tmp_path: Path, capsys) -> None:
    log = tmp_path / 'flight.bin'
    log.write_bytes(writers.dataflash_bytes([read_bag(bags / 'dut1_z').rows(slice(0, 300))]))
    command = ['import', str(log), '-o', str(tmp_path / 'part')]
    assert main([*command, '--from', '12']) == 2
    assert 'give --from and --to as times' in capsys.readouterr().err
    assert main([*command, '--from', '5h']) == 2
    assert main([*command, '--from', '1min', '--to', '2min']) == 0
    assert len(read_bag(tmp_path / 'part' / 'imu0')) == 31


def test_files_are_joined_with_a_guess_that_is_saved(tmp_path: Path, capsys) -> None:
    board, chamber = tmp_path / 'board.csv', tmp_path / 'chamber.csv'
    rows = (f'{0.1 * k:.1f},0.1,0.2,9.8,0.01,0.02,0.03,{30 + 0.01 * k}' for k in range(500))
    board.write_text('\n'.join(['time,ax,ay,az,gx,gy,gz,temp', *rows]))
    rows = (f'{k};{20 + k};{25 + k}' for k in range(0, 51, 5))
    chamber.write_text('\n'.join(['seconds;Temp;SP', *rows]))
    files = ['import', str(board), str(chamber)]
    assert main(files) == 0
    saved = tmp_path / 'both.yaml'
    saved.write_text(capsys.readouterr().out)
    command = [*files, '--mapping', str(saved), '-o', str(tmp_path / 'bag')]
    assert main(command) == 0
    assert 'chamber.csv: 11 samples joined by time' in capsys.readouterr().out
    air = read_bag(tmp_path / 'bag').chamber_temperature
    assert air is not None
    assert air[[49, 50]].tolist() == [20.0, 25.0]
    assert main(['import', str(board), '--mapping', str(saved), '-o', str(tmp_path / 'b')]) == 2
    assert '1 files and 2 mappings' in capsys.readouterr().err
    assert main([*files, '--yes', '-o', str(tmp_path / 'guessed')]) == 0
    assert 'Temp is taken for the air, not for a die' in capsys.readouterr().out


def test_an_import_shows_the_ranges_and_refuses_another_unit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, mapping = tmp_path / 'a.csv', tmp_path / 'm.yaml'
    table.write_text('t,a,b,c,T\n' + ''.join(f'{k},0,0,1,{20 + k / 50}\n' for k in range(200)))
    told = (
        'schema: 1\ntime: {{column: t}}\ncolumns:\n  temperature: {{column: T}}\n'
        '  linear_acceleration: {{columns: [a, b, c]{}}}\n'
    )
    argv = ['import', str(table), '--mapping', str(mapping), '-o', str(tmp_path / 'bag')]
    mapping.write_text(told.format(''))
    assert main(argv) == 2
    assert 'as if in g' in capsys.readouterr().err
    mapping.write_text(told.format(', unit: g'))
    assert main(argv) == 0
    words = capsys.readouterr().out.split()
    at = words.index('temperature')
    assert words[at : at + 5] == ['temperature', '20.0', '22.0', '24.0', '°C']
