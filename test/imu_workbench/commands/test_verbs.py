# SPDX-License-Identifier: Apache-2.0
"""The verbs over real bags, through the front end: answers, files, exit codes."""

import doctest
import json
import runpy
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml
from imu_recording.bags.messages import BagMessage, bag_topics, read_messages, write_messages
from imu_workbench.__main__ import build_parser, main
from imu_workbench.answer import CHECK_FAILED
from imu_workbench.commands import COMMANDS, options
from imu_workbench.web.case.tasks import read_task
from matplotlib.image import imread
from thermal_comp.model.file import load_model

from imu_recording import read_bag, write_bag

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope='module')
def folder(run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bags of two devices, one with both in namespaces."""
    path = tmp_path_factory.mktemp('bags')
    for device in ('dut1', 'dut2'):
        write_bag(run(device, 'z', cycles=3), path / device)
    both = [replace(run(d, cycles=3), namespace=f'/{d}') for d in ('dut1', 'dut2')]
    write_bag(both, path / 'both')
    return path


@pytest.fixture(scope='module')
def model(folder: Path) -> Path:
    target = folder / 'dut1.yaml'
    assert main(['fit', str(folder / 'dut1'), '-o', str(target)]) == 0
    return target


def test_every_verb_keeps_the_contract() -> None:
    for verb, module_name in COMMANDS.items():
        command = import_module(f'imu_workbench.commands.{module_name}')
        assert len(command.HELP.splitlines()) == 1, verb
        assert callable(command.run)
        build_parser(verb)


@pytest.mark.parametrize('verb', sorted(COMMANDS))
def test_help_is_enough(verb: str, capsys) -> None:
    assert main([verb, '--help']) == 0
    shown = capsys.readouterr().out
    assert '--json' in shown
    assert len(shown.splitlines()) > 5


def test_the_version_is_the_packages(capsys) -> None:
    assert main(['--version']) == 0
    assert capsys.readouterr().out == '0.2.0\n'


def test_the_list_of_verbs_needs_no_library() -> None:
    path = ROOT / 'src/imu_workbench/imu_workbench/commands/__init__.py'
    script = f'import runpy; print(*runpy.run_path({str(path)!r})["COMMANDS"])'
    found = subprocess.run(  # -I -S: no site packages at all
        [sys.executable, '-I', '-S', '-c', script], capture_output=True, text=True, check=True
    )
    assert found.stdout.split() == list(COMMANDS)
    assert runpy.run_path(str(path))['COMMANDS'] == COMMANDS


def test_option_examples_hold() -> None:
    assert doctest.testmod(options).failed == 0


def test_fit_saves_what_it_says(folder: Path, tmp_path: Path) -> None:
    answer, target = tmp_path / 'fit.json', tmp_path / 'm.yaml'
    assert main(['fit', str(folder / 'dut1'), '-o', str(target), '--json', str(answer)]) == 0
    content = json.loads(answer.read_text())
    assert content['schema'] == 1
    assert content['device'] == 'dut1'
    part = content['sensors']['gyroscope']
    assert part['unit'] == 'rad/s'
    for name in ('measured_rms', 'residual_rms', 'held_out_rms', 'noise_floor'):
        assert len(part[name]) == 3
    slope = load_model(target).sensors['gyroscope'].coefficients[0][0]
    np.testing.assert_allclose(slope, [4e-5, -2e-5, 1e-5], atol=1e-6)


def test_compare_with_the_saved_model_gives_the_numbers_of_the_fit(
    folder: Path, model: Path, tmp_path: Path
) -> None:
    bag = str(folder / 'dut1')
    files = [tmp_path / 'a.json', tmp_path / 'b.json']
    assert main(['compare', bag, '--model', str(model), '--json', str(files[0])]) == 0
    assert main(['compare', bag, '--json', str(files[1])]) == 0
    saved, fresh = (json.loads(file.read_text())['sensors'] for file in files)
    for sensor, part in saved.items():
        np.testing.assert_allclose(part['residual_rms'], fresh[sensor]['residual_rms'], rtol=1e-9)
        np.testing.assert_allclose(part['held_out_rms'], fresh[sensor]['held_out_rms'], rtol=1e-6)


def test_compare_draws_the_residual_over_time(
    folder: Path, model: Path, tmp_path: Path, capsys
) -> None:
    picture = tmp_path / 'residual.png'
    argv = ['compare', str(folder / 'dut1'), '--model', str(model), '--plot']
    assert main([*argv, str(picture)]) == 0
    pixels = imread(picture)[:, :, :3]
    assert (pixels[0, 0] == 1.0).all(), 'the background is white'
    dark = (pixels.min(axis=2) < 0.8).mean()
    assert dark > 0.02, 'lines are drawn'
    assert main([*argv, str(picture)]) == 2
    assert '--force' in capsys.readouterr().err
    assert main([*argv, str(tmp_path / 'residual.xyz')]) == 2
    assert '.png, .svg, .pdf' in capsys.readouterr().err


def test_apply_removes_the_slope(folder: Path, model: Path, tmp_path: Path) -> None:
    target = tmp_path / 'compensated'
    assert main(['apply', str(folder / 'dut1'), '--model', str(model), '-o', str(target)]) == 0
    before, after = read_bag(folder / 'dut1'), read_bag(target)
    np.testing.assert_array_equal(before.stamp, after.stamp)
    np.testing.assert_array_equal(before.temperature, after.temperature)
    for name in ('angular_velocity', 'linear_acceleration', 'magnetic_field'):
        old = np.polyfit(before.temperature, getattr(before, name), 1)[0]
        new = np.polyfit(after.temperature, getattr(after, name), 1)[0]
        assert (np.abs(new) < 0.02 * np.abs(old).max()).all()


@pytest.fixture
def robot(folder: Path, tmp_path: Path) -> tuple[Path, Path]:
    """A bag under a robot's own names, with a topic nobody here reads, and the file of names."""
    names = {
        'imu/data_raw': '/camera/imu',
        'imu/mag': '/compass',
        'imu/temperature': '/camera/temperature',
    }
    types = {t: kind for t, kind in bag_topics(folder / 'dut1').items() if t[1:] in names}
    messages = read_messages(folder / 'dut1', list(types))
    text = b'\x00\x01\x00\x00\x03\x00\x00\x00hi\x00'
    renamed = [replace(m, topic=names[m.topic[1:]]) for m in messages]
    kinds = {names[t[1:]]: kind for t, kind in types.items()}
    write_messages(
        [BagMessage(messages[0].received, '/chatter', text), *renamed],
        {**kinds, '/chatter': 'std_msgs/msg/String'},
        tmp_path / 'robot',
    )
    rules = tmp_path / 'robot.yaml'
    rules.write_text(''.join(f'{name}: {other}\n' for name, other in names.items()))
    return tmp_path / 'robot', rules


def test_apply_keeps_every_topic_and_adds_its_own(
    robot: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    bag, rules = robot
    model, out, again = (str(tmp_path / name) for name in ('m.yaml', 'out', 'again'))
    topics = ['--topics', str(rules)]
    assert main(['fit', str(bag), *topics, '-o', model]) == 0
    assert main(['apply', str(bag), *topics, '--model', model, '-o', out]) == 0
    before, after = bag_topics(bag), bag_topics(out)
    assert set(after) - set(before) == {
        f'/imu_compensated/{name}' for name in ('data_raw', 'mag', 'applied_model')
    }
    assert read_messages(out, list(before)) == read_messages(bag, list(before))
    # What apply wrote is read as compensated, and nothing is subtracted twice unasked.
    temperature = ['--topic', 'imu/temperature:=/camera/temperature']
    capsys.readouterr()
    for argv in (
        ['apply', out, *temperature, '--model', model, '-o', again],
        ['fit', out, *temperature, '-o', again],
        ['diagnose', out, *temperature],
        ['orient', out, *temperature, '--model', model],
    ):
        assert main(argv) == 2
        assert 'compensated already (model of' in capsys.readouterr().err
    remap = {'imu/temperature': '/camera/temperature'}
    assert read_bag(out, remap=remap).compensated.startswith('model of a device without name')
    assert not read_bag(out, remap=yaml.safe_load(rules.read_text())).compensated
    told = {**remap, 'imu/data_raw': '/imu_compensated/data_raw'}
    assert read_bag(out, remap=told).compensated


def test_the_page_reads_a_bag_under_its_own_names(
    robot: tuple[Path, Path], tmp_path: Path
) -> None:
    bag, rules = robot
    told = build_parser('serve').parse_args(['serve', str(bag), '--topics', str(rules)])
    (stored,) = read_task(lambda _: None, bag, tmp_path, options.topic_remap(told))
    assert np.isfinite(stored.recording().temperature).all()


def test_a_remapped_imu_is_told_which_temperatures_there_are(
    robot: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    argv = ['fit', str(robot[0]), '--topic', 'imu/data_raw:=/camera/imu']
    assert main([*argv, '-o', str(tmp_path / 'm.yaml')]) == 2
    assert '--topic imu/temperature:=/camera/temperature' in capsys.readouterr().err


def test_a_wrong_file_of_topics_is_told_by_its_key(
    robot: tuple[Path, Path], tmp_path: Path, capsys
) -> None:
    bag, rules = robot
    for text, message in (
        ('imu/data_row: /x\n', "'imu/data_row' is no name in a recording (did you mean imu/data_"),
        ('imu/mag: [1\n', 'line 2'),
        ('- a\n', 'expected lines such as'),
    ):
        rules.write_text(text)
        argv = ['fit', str(bag), '--topics', str(rules), '-o', str(tmp_path / 'm.yaml')]
        assert main(argv) == 2
        assert message in capsys.readouterr().err


def test_apply_of_several_writes_one_bag_each(folder: Path, model: Path, tmp_path: Path) -> None:
    write_bag(read_bag(folder / 'dut1'), tmp_path / 'second')
    bags = [str(folder / 'dut1'), str(tmp_path / 'second')]
    target = tmp_path / 'out'
    assert main(['apply', *bags, '--model', str(model), '-o', str(target)]) == 0
    assert sorted(p.name for p in target.iterdir()) == ['dut1', 'second']
    assert main(['apply', *bags, '--model', str(model), '-o', str(target)]) == 2


def test_a_model_that_held_out_parts_speak_against_is_saved_by_force_alone(
    run, tmp_path: Path, capsys
) -> None:
    """A slope that turns its sign from cycle to cycle: a line does harm on the one left out."""
    recording = run('dut1', 'z', cycles=4)
    sign = np.where(recording.cycle % 2 == 1, 1.0, -1.0) * (recording.cycle > 0)
    swing = (sign * (recording.temperature - 22.5))[:, None] * 1e-3
    write_bag(
        replace(recording, angular_velocity=recording.angular_velocity + swing), tmp_path / 'bag'
    )
    target, answer = tmp_path / 'm.yaml', tmp_path / 'a.json'
    argv = ['fit', str(tmp_path / 'bag'), '-o', str(target)]
    assert main([*argv, '--json', str(answer)]) == CHECK_FAILED
    (line,) = (t for t in capsys.readouterr().out.splitlines() if t.startswith('not saved'))
    assert 'gyroscope x: the error on held-out parts is' in line
    assert '--force saves it' in line
    assert not target.exists()
    assert json.loads(answer.read_text())['model'] is None
    assert main([*argv, '--force']) == 0
    assert load_model(target).device == 'dut1'


@pytest.mark.parametrize('verb', ['apply', 'compare', 'diagnose', 'add', 'auto', 'orient'])
def test_a_model_of_another_device_is_refused(
    verb: str, folder: Path, model: Path, tmp_path: Path, capsys
) -> None:
    target = ['-o', str(tmp_path / 'out')] if verb in {'apply', 'add', 'auto'} else []
    effect = ['thermal_lag'] if verb == 'add' else []
    argv = [verb, *effect, str(folder / 'dut2'), '--model', str(model), *target]
    assert main(argv) == 2
    (line,) = (text for text in capsys.readouterr().err.splitlines() if 'model' in text)
    assert 'the model is of dut1, the data of dut2; fit a model of that device' in line
    assert not (tmp_path / 'out').exists()


def test_pooling_is_refuted_by_opposite_slopes(folder: Path, tmp_path: Path, capsys) -> None:
    bags = [str(folder / 'dut1'), str(folder / 'dut2')]
    assert main(['fit', *bags, '-o', str(tmp_path / 'm.yaml')]) == 2
    assert '--pooled' in capsys.readouterr().err
    answer = tmp_path / 'a.json'
    argv = ['fit', *bags, '--pooled', '-o', str(tmp_path / 'm.yaml'), '--json', str(answer)]
    assert main(argv) == 0
    assert 'one model cannot hold for all' in capsys.readouterr().out
    tests = json.loads(answer.read_text())['pooling']
    for test in tests.values():
        assert test['opposite_signs'] == [True, True, True]
        assert np.min(np.divide(test['pooled_rms'], test['own_rms'])) > 1.5


def test_several_devices_in_one_bag(folder: Path, tmp_path: Path, capsys) -> None:
    both, target = str(folder / 'both'), tmp_path / 'm.yaml'
    assert main(['fit', both, '-o', str(target)]) == 2
    assert '/dut1, /dut2' in capsys.readouterr().err
    assert main(['fit', both, '--namespace', '/dut2', '-o', str(target)]) == 0
    assert load_model(target).device == 'dut2'
    page, answer = tmp_path / 'r.html', tmp_path / 'r.json'
    argv = ['report', both, '--no-attitude', '--no-diagnosis', '-o', str(page)]
    assert main([*argv, '--json', str(answer)]) == 0
    content = json.loads(answer.read_text())
    assert [d['name'] for d in content['devices']] == ['dut1', 'dut2']
    assert page.read_text('utf-8').startswith('<!DOCTYPE html>')


def test_a_report_uses_the_model_it_is_given(folder: Path, model: Path, tmp_path: Path) -> None:
    argv = ['report', str(folder / 'dut1'), '--no-attitude', '-o', str(tmp_path / 'r.html')]
    assert main([*argv, '--model', str(model)]) == 0
    assert main([*argv, '--model', str(model), '--model', str(model)]) == 2
    other = [*argv[:1], str(folder / 'dut2'), *argv[2:]]
    assert main([*other, '--model', str(model)]) == 2


def test_topics_can_be_renamed_or_left_out(folder: Path, tmp_path: Path) -> None:
    target = tmp_path / 'm.yaml'
    argv = ['fit', str(folder / 'dut1'), '-o', str(target)]
    assert main([*argv, '--topic', 'imu/mag:=']) == 0
    assert 'magnetometer' not in load_model(target).sensors
    assert main([*argv, '--topic', 'imu/mag']) == 2
    assert main([*argv, '--topic', 'imu/mag:=/nowhere']) == 2


@pytest.mark.shared_data
def test_a_measured_recording_goes_all_the_way(shared: Path, tmp_path: Path) -> None:
    bag, target = tmp_path / 'freeimu', tmp_path / 'm.yaml'
    csv = shared / 'data/freeimu_freezer/Tempdata01-02-14.csv'
    mapping = ROOT / 'examples/freeimu_mapping.yaml'
    assert main(['import', str(csv), '--mapping', str(mapping), '-o', str(bag)]) == 0
    assert main(['fit', str(bag), '-o', str(target)]) == 0
    page, answer = tmp_path / 'r.html', tmp_path / 'r.json'
    argv = ['report', str(bag), '--model', str(target), '-o', str(page), '--json', str(answer)]
    assert main(argv) == 0
    content = json.loads(answer.read_text())
    gyroscope = content['comparison']['freeimu']['sensors']['gyroscope']
    # The board's y gyroscope drifts 0.35 °/s over 18 K; a line takes most of that away.
    assert gyroscope['residual_rms'][1] < 0.1 * gyroscope['measured_rms'][1]
    assert content['recordings'][0]['plan']['phases'] == []
