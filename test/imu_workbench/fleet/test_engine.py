# SPDX-License-Identifier: Apache-2.0
"""The engine of a fleet: what is done is done once, and a bad device is a row."""

from __future__ import annotations

import itertools
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from imu_driver.simulation.devices import TYPICAL_SPREAD
from imu_recording.user_error import UserError
from imu_workbench.__main__ import main
from imu_workbench.fleet import engine
from imu_workbench.fleet.engine import Cluster, FleetProgress, connected, outcomes, run_fleet
from imu_workbench.fleet.estimate import EstimateSettings
from imu_workbench.fleet.sources import find_devices
from imu_workbench.fleet.table import FleetTable
from imu_workbench.simulate.campaign import Logging
from imu_workbench.simulate.fleet import FleetPlan, fleet_truth, write_fleet

HERE = Cluster(workers=1, processes=False)


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('fleet') / 'bags'
    write_fleet(FleetPlan('short_20min', 3, 2, 3, Logging(0.5, mean=True)), folder, 1)
    return folder


def run(sources: list[Path], folder: Path, start: int = 1) -> FleetProgress:
    ticks = itertools.count(start * 10**12, 3 * 10**9)
    devices = find_devices([str(source) for source in sources])
    return run_fleet(devices, folder, EstimateSettings(), HERE, clock=lambda: next(ticks))


def test_rows_tell_the_slopes_and_a_second_run_does_only_what_changed(
    bags: Path, tmp_path: Path
) -> None:
    copied = tmp_path / 'bags'
    shutil.copytree(bags, copied, copy_function=shutil.copy2)
    out = tmp_path / 'out'
    first = run([copied], out)
    assert (first.devices, first.estimated, first.failed) == (3, 3, {})
    assert run([copied], out, 2).unchanged == 3
    touched = next((copied / 'lot=A' / 'A00001' / 'x').glob('*.mcap'))
    touched.write_bytes(touched.read_bytes())
    second = run([copied], out, 3)
    assert (second.estimated, second.unchanged) == (1, 2)
    found = FleetTable(out).rows(
        'SELECT device, lot, list(coefficients[1] ORDER BY sensor, axis), '
        'list(std[1] ORDER BY sensor, axis), count(DISTINCT input_hash) FROM results '
        "WHERE role = 'fitted' GROUP BY device, lot ORDER BY device"
    )
    truth = fleet_truth(bags)
    assert truth is not None
    assert [row[:2] for row in found] == [('A00001', 'A'), ('A00002', 'A'), ('B00003', 'B')]
    for device, _, slopes, std, hashes in found:
        wanted = np.array(truth['devices'][device]['slopes']).reshape(3, 3)
        error = np.array(slopes).reshape(3, 3) - wanted[[0, 1, 2]]
        of_the_class = np.array([[TYPICAL_SPREAD[name][1]] for name in sorted(TYPICAL_SPREAD)])
        # Hidden effects and the thermometer's own error move a slope beyond its deviation.
        assert (np.abs(error) < 6 * np.array(std).reshape(3, 3) + 0.3 * of_the_class).all()
        assert hashes == 1


def test_a_bad_device_is_a_row_with_its_reason(bags: Path, tmp_path: Path) -> None:
    copied = tmp_path / 'bags'
    shutil.copytree(bags, copied)
    broken = next((copied / 'lot=A' / 'A00001' / 'x').glob('*.mcap'))
    broken.write_bytes(b'no bag')
    shutil.copytree(copied / 'lot=A' / 'A00002', copied / 'lot=A' / 'again')
    done = run([copied], tmp_path / 'out')
    assert done.estimated == 1
    assert sorted(done.failed) == ['A00001', 'A00002']
    assert 'stands in 2 folders' in done.failed['A00002']
    rows = FleetTable(tmp_path / 'out').rows(
        "SELECT device, reason FROM results WHERE role = 'failed' ORDER BY device"
    )
    assert [row[0] for row in rows] == ['A00001', 'A00002', 'A00002']
    assert all(row[1] for row in rows)


def test_what_was_written_before_an_interruption_is_not_done_again(
    bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = engine.outcomes

    def interrupted(*arguments: object) -> object:
        yield next(whole(*arguments))  # type: ignore[arg-type]
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, 'outcomes', interrupted)
    with pytest.raises(KeyboardInterrupt):
        run([bags], tmp_path)
    monkeypatch.setattr(engine, 'outcomes', whole)
    after = run([bags], tmp_path, 2)
    assert (after.unchanged, after.estimated) == (1, 2)
    rows = FleetTable(tmp_path).rows("SELECT count(*) FROM results WHERE role = 'fitted'")
    assert rows == [(27,)]


@pytest.mark.end_to_end
def test_the_verb_starts_workers_and_writes_the_page(bags: Path, tmp_path: Path) -> None:
    out, answer = tmp_path / 'out', tmp_path / 'answer.json'
    call = ['fleet', f'{bags}/lot=B', '-o', str(out), '--workers', '1', '--json', str(answer)]
    assert main(call) == 0
    assert json.loads(answer.read_text())['run']['estimated'] == 1
    assert json.loads((out / 'study.json').read_text())['devices'] == 1
    assert '<title>Fleet</title>' in (out / 'report.html').read_text()


def test_sources_are_globs_lists_and_urls(bags: Path, tmp_path: Path) -> None:
    listed = tmp_path / 'list.csv'
    listed.write_text(f'source,lot,type\n{bags}/lot=A/A00001,Q,LSM\nfile://{bags}/lot=B,,\n')
    devices = find_devices([str(listed), f'{bags}/lot=A/A0000?'])
    assert [(d.device, d.lot, d.type) for d in devices] == [
        ('A00002', 'A', 'none'), ('B00003', 'B', 'none'), ('A00001', 'Q', 'LSM'),
    ]  # fmt: skip
    assert all(len(device.bags) == 3 for device in devices)
    with pytest.raises(UserError, match='no bag here'):
        find_devices([str(tmp_path / 'nowhere')])
    listed.write_text(f'source\n{bags}/lot=B\n{tmp_path}/gone\n')
    missing, found = sorted(find_devices([str(listed)]), key=lambda device: device.device)
    assert found.device == 'B00003'
    assert 'gone: no bag here' in missing.problem
    listed.write_text('path\nx\n')
    with pytest.raises(UserError, match='a list has source'):
        find_devices([str(listed)])


@pytest.fixture
def site() -> Iterator[Callable[[int], SimpleNamespace]]:
    """Start a scheduler for `dask worker` processes elsewhere; (workers) → address and cluster."""
    from distributed import LocalCluster

    with ExitStack() as open_:

        def start(workers: int) -> SimpleNamespace:
            cluster = open_.enter_context(
                LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=False, protocol='tcp://',
                    dashboard_address=None, silence_logs=50,
                )
            )  # fmt: skip
            return SimpleNamespace(cluster=cluster, address=cluster.scheduler_address)

        yield start


def test_a_scheduler_without_workers_or_with_others_software_is_refused(
    bags: Path, tmp_path: Path, site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, 'CONNECT_S', 1.0)
    with (
        pytest.raises(UserError, match='it has no workers; start `dask worker tcp://'),
        connected(Cluster(site(0).address)),
    ):
        pass
    address = site(1).address
    with connected(Cluster(address)) as client:
        (rows,) = outcomes(client, find_devices([f'{bags}/lot=B']), EstimateSettings())
        assert {row['device'] for row in rows} == {'B00003'}
    monkeypatch.setattr(engine, '_here', lambda: '9.9')
    with (
        pytest.raises(UserError, match=r'has version .*, here is 9\.9'),
        connected(Cluster(address)),
    ):
        pass


def test_a_cluster_that_grows_is_given_more_devices(
    bags: Path, site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, 'TASKS_PER_WORKER', 1)
    here, submitted = site(1), []
    with connected(Cluster(here.address)) as client:
        submit = client.submit

        def counted(*arguments: object, **options: object) -> object:
            submitted.append(arguments)
            return submit(*arguments, **options)

        monkeypatch.setattr(client, 'submit', counted)
        rows = outcomes(client, find_devices([str(bags)]), EstimateSettings())
        next(rows)
        assert len(submitted) == 1
        here.cluster.adapt(minimum=2, maximum=2, interval='100ms')
        client.wait_for_workers(2, timeout=60)
        next(rows)
        assert len(submitted) == 3
        assert len(list(rows)) == 1


def test_a_scheduler_that_goes_away_is_said_in_one_line(bags: Path, site) -> None:
    here = site(1)
    with connected(Cluster(here.address)) as client:
        rows = outcomes(client, find_devices([str(bags)]), EstimateSettings())
        next(rows)
        here.cluster.close()
        with pytest.raises(UserError, match='the scheduler has gone'):
            list(rows)


def test_mistakes_are_one_line(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, 'CONNECT_S', 0.2)
    call = ['fleet', str(bags), '-o', str(tmp_path / 'out')]
    assert main(['reveal', str(bags), '--fleet', str(tmp_path)]) == 2
    assert 'no results here' in capsys.readouterr().err
    assert main([*call, '--scheduler', 'tcp://127.0.0.1:9']) == 2
    assert 'no answer' in capsys.readouterr().err
    for option, value in (('--workers', '0'), ('--memory', 'lots'), ('--memory', '5')):
        assert main([*call, option, value]) == 2
        assert f'{option} {value}' in capsys.readouterr().err
    monkeypatch.setattr('imu_workbench.fleet.extra.LIBRARIES', ())
    monkeypatch.setattr('imu_workbench.fleet.extra.find_spec', lambda name: None)
    assert main(call) == 2
    assert 'requirements-fleet.txt' in capsys.readouterr().err


def copied(bags: Path, device: str, target: Path) -> Path:
    shutil.copytree(bags / device, target)
    return target


def test_a_device_that_was_given_twice_or_moved_has_one_estimate(
    bags: Path, tmp_path: Path
) -> None:
    first = copied(bags, 'lot=A/A00001', tmp_path / 'in' / 'A00001')
    twin = copied(bags, 'lot=A/A00001', tmp_path / 'in' / 'twin')
    for bag in twin.iterdir():
        (bag / 'metadata.yaml').unlink()  # who it is stands in the file alone
    out = tmp_path / 'out'
    done = run([tmp_path / 'in'], out)
    assert done.estimated == 0
    assert 'stands in 2 folders' in done.failed['A00001']
    shutil.rmtree(twin)
    assert run([tmp_path / 'in'], out, 2).estimated == 1
    moved = tmp_path / 'in' / 'lot=Q' / 'A00001'
    moved.parent.mkdir()
    first.rename(moved)
    assert run([tmp_path / 'in'], out, 3).estimated == 1
    query = "SELECT DISTINCT lot, device FROM results WHERE role = 'fitted'"
    assert FleetTable(out).rows(query) == [('Q', 'A00001')]
    listed = tmp_path / 'list.csv'
    listed.write_text(f'source,lot\n{moved},Z\n')
    assert run([listed], out, 4).estimated == 1  # another lot is a change too
    assert FleetTable(out).rows(query) == [('Z', 'A00001')]


def test_a_bag_that_names_nobody_belongs_to_its_neighbour(bags: Path, tmp_path: Path) -> None:
    folder = copied(bags, 'lot=A/A00001', tmp_path / 'A00001')
    (folder / 'z' / 'metadata.yaml').unlink()
    (device,) = find_devices([str(tmp_path)])
    assert (device.device, len(device.bags)) == ('A00001', 3)


def test_a_folder_that_may_not_be_read_is_a_device_with_that_reason(
    bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied(bags, 'lot=A/A00001', tmp_path / 'A00001')
    # Root may read everything.
    monkeypatch.setattr(os, 'access', lambda path, mode: not str(path).endswith('A00001/y'))
    (device,) = find_devices([str(tmp_path)])
    assert device.problem == f'{tmp_path}/A00001/y: no permission to read it'
    (device,) = find_devices([str(tmp_path / 'A00001' / 'y')])
    assert device.problem


def test_results_that_cannot_be_read_or_written_are_one_line(
    bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    (out / 'results' / 'lot=A').mkdir(parents=True)
    (out / 'results' / 'lot=A' / 'part-1.parquet').write_bytes(b'torn')
    assert main(['fleet', str(bags), '-o', str(out)]) == 2
    line = capsys.readouterr().err
    assert 'part-1.parquet' in line
    assert 'delete the file' in line
    blocked = tmp_path / 'blocked'
    blocked.mkdir()
    (blocked / 'results').write_text('a file')
    with pytest.raises(UserError, match='what is written is not done twice'):
        run([bags / 'lot=B'], blocked)
