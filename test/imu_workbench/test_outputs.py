# SPDX-License-Identifier: Apache-2.0
"""What verbs may write over: nothing that is read, whatever is forced; else only by force."""

from __future__ import annotations

import shutil
from argparse import Namespace
from pathlib import Path

import pytest
from imu_recording.user_error import UserError
from imu_workbench.__main__ import main
from imu_workbench.outputs import claim_output, refuse_to_destroy, replacing

from imu_recording import read_bag, write_bag


def test_nothing_that_exists_is_replaced_unasked(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, bag = tmp_path / 'm.yaml', tmp_path / 'bag'
    model.write_text('mine')
    bag.mkdir()
    (bag / 'thesis.tex').write_text('mine')
    dut, simulate = str(bags / 'dut1_x'), ['simulate', 'short_20min', '--rate', '0.1']
    for argv in (
        ['fit', dut, '-o', str(model)],
        ['auto', dut, '-o', str(model)],
        ['add', 'thermal_lag', dut, '-o', str(model)],
        ['report', dut, '-o', str(model)],
        [*simulate, '-o', str(bag)],
        [*simulate, '--orientation', 'x', '-o', str(bag)],
        [*simulate, '--orientation', 'x', '-o', str(bag), '--force'],
    ):
        assert main(argv) == 2
        assert str(tmp_path) in capsys.readouterr().err
    assert model.read_text() == 'mine'
    assert [path.name for path in bag.iterdir()] == ['thesis.tex']
    assert main(['fit', dut, '-o', str(model), '--force']) == 0
    assert model.read_text().startswith('schema: 1')
    for force in ([], ['--force']):
        argv = [*simulate, '--orientation', 'x', '-o', str(tmp_path / 'run'), *force]
        assert main(argv) == 0


def test_no_force_replaces_what_is_read_or_a_recording(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, other = tmp_path / 'bag', tmp_path / 'other'
    for copy in (bag, other):
        shutil.copytree(bags / 'dut1_x', copy)
    model, rules = tmp_path / 'm.yaml', tmp_path / 'topics.yaml'
    rules.write_text('imu/mag: imu/mag\n')
    assert main(['fit', str(bag), '-o', str(model)]) == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob('*') if path.is_file()}
    storage = next(other.glob('*.mcap'))
    fit = ['fit', str(bag), '--topics', str(rules), '--force']
    for argv, said in (
        ([*fit, '-o', str(other / 'metadata.yaml')], 'belongs to a recording'),
        ([*fit, '-o', str(storage)], 'belongs to a recording'),
        ([*fit, '-o', str(rules)], 'is what is read'),
        (['compare', str(bag), '--json', str(other / 'metadata.yaml')], 'belongs to a recording'),
        (['compare', str(bag), '--json', str(model)], 'no .json file'),
        (['compare', str(bag), '--plot', str(storage)], 'belongs to a recording'),
        (['apply', str(bag), '--model', str(model), '-o', str(bag), '--force'], 'is what is read'),
    ):
        capsys.readouterr()
        assert main(argv) == 2
        said_in_all = capsys.readouterr().err
        assert said in said_in_all
        assert said_in_all.count('\n') == 1
    assert {path: path.read_bytes() for path in tmp_path.rglob('*') if path.is_file()} == before
    assert main(['fit', str(bag), '-o', str(model), '--force']) == 0


def test_what_is_replaced_stays_until_the_new_bag_is_written(
    bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, out, bag = tmp_path / 'm.yaml', tmp_path / 'out', tmp_path / 'bag'
    write_bag(read_bag(bags / 'dut1_x').rows(slice(None, None, 10)), bag)
    assert main(['fit', str(bag), '-o', str(model)]) == 0
    apply = ['apply', str(bag), '--model', str(model), '-o', str(out)]
    table, mapping = tmp_path / 'a.csv', tmp_path / 'm.csv.yaml'
    table.write_text('t,a,b,c\n' + ''.join(f'{k},0,0,9.8\n' for k in range(200)))
    mapping.write_text(
        'schema: 1\ntime: {column: t}\ncolumns:\n  linear_acceleration: {columns: [a, b, c]}\n'
    )
    convert = ['import', str(table), '--mapping', str(mapping), '-o', str(out)]
    assert main(apply) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def full_disk(*_: object, **__: object) -> None:
        raise OSError(28, 'No space left on device', str(out))

    with monkeypatch.context() as patched:
        patched.setattr('imu_workbench.commands.apply.write_compensated_copy', full_disk)
        patched.setattr('imu_workbench.commands.import_file.write_bag', full_disk)
        assert main([*apply, '--force']) == main([*convert, '--force']) == 2
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert main([*convert, '--force']) == 0
    assert len(read_bag(out)) == 200
    assert {path.name for path in tmp_path.iterdir()} == {
        'm.yaml', 'out', 'bag', 'a.csv', 'm.csv.yaml'
    }  # fmt: skip


def test_a_folder_makes_way_only_for_a_bag_and_only_if_it_is_one(tmp_path: Path) -> None:
    target = tmp_path / 'out'
    claim_output(target, force=False, folder=True)
    target.mkdir()
    with pytest.raises(UserError, match='exists already'):
        claim_output(target, force=False, folder=True)
    for folder, kind in ((True, 'a bag'), (False, 'a file')):
        with pytest.raises(UserError, match=f'is not {kind}'):
            claim_output(target, force=True, folder=folder)
    (target / 'metadata.yaml').touch()
    claim_output(target, force=True, folder=True)
    with pytest.raises(UserError, match='there is no folder'):
        claim_output(tmp_path / 'nowhere' / 'm.yaml', force=True)


def test_a_model_may_be_replaced_by_the_next_one_but_not_its_recording(tmp_path: Path) -> None:
    model, bag = tmp_path / 'm.yaml', tmp_path / 'run.bag'
    for path in (model, bag):
        path.touch()
    refuse_to_destroy(Namespace(bags=[bag], model=model, output=model))
    with pytest.raises(UserError, match=r'-o .* is what is read'):
        refuse_to_destroy(Namespace(bags=[bag], model=model, output=bag))


def put(target: Path, text: str, *, fails: bool = False) -> None:
    with replacing(target) as fresh:
        fresh.mkdir()
        (fresh / 'metadata.yaml').write_text(text)
        if fails:
            raise OSError('the disk is full')


def test_an_old_bag_stays_where_the_new_one_fails(tmp_path: Path) -> None:
    target = tmp_path / 'bag'
    put(target, 'old')
    put(target, 'new')
    assert (target / 'metadata.yaml').read_text() == 'new'
    with pytest.raises(OSError, match='full'):
        put(target, 'broken', fails=True)
    assert (target / 'metadata.yaml').read_text() == 'new'
    assert [path.name for path in tmp_path.iterdir()] == ['bag']
