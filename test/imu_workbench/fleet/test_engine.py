# SPDX-License-Identifier: Apache-2.0
"""The engine of a fleet: what is done is done once, and a bad device is a row."""

from __future__ import annotations

import itertools
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from imu_driver.simulation.devices import TYPICAL_STD
from imu_recording.user_error import UserError
from imu_workbench.__main__ import main
from imu_workbench.fleet import engine
from imu_workbench.fleet.engine import Cluster, FleetProgress, connected, outcomes, run_fleet
from imu_workbench.fleet.estimate import EstimateSettings
from imu_workbench.fleet.sources import find_devices
from imu_workbench.fleet.table import FleetTable
from imu_workbench.simulate.fleet import fleet_truth

HERE = Cluster(workers=1, processes=False)


def run(sources: list[Path], folder: Path, start: int = 1) -> FleetProgress:
    ticks = itertools.count(start * 10**12, 3 * 10**9)
    devices = find_devices([str(source) for source in sources])
    return run_fleet(devices, folder, EstimateSettings(), HERE, clock=lambda: next(ticks))


def test_rows_tell_the_slopes_and_a_second_run_does_only_what_changed(
    fleet_bags: Path, tmp_path: Path
) -> None:
    copied = tmp_path / 'bags'
    shutil.copytree(fleet_bags, copied, copy_function=shutil.copy2)
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
    truth = fleet_truth(fleet_bags)
    assert truth is not None
    assert [row[:2] for row in found] == [('A00001', 'A'), ('A00002', 'A'), ('B00003', 'B')]
    for device, _, slopes, std, hashes in found:
        wanted = np.array(truth['devices'][device]['slopes']).reshape(3, 3)
        error = np.array(slopes).reshape(3, 3) - wanted[[0, 1, 2]]
        of_the_class = np.array([[TYPICAL_STD[name][1]] for name in sorted(TYPICAL_STD)])
        # Hidden effects and the thermometer's own error move a slope beyond its deviation.
        assert (np.abs(error) < 6 * np.array(std).reshape(3, 3) + 0.3 * of_the_class).all()
        assert hashes == 1


def test_a_bad_device_is_a_row_with_its_reason(fleet_bags: Path, tmp_path: Path) -> None:
    copied = tmp_path / 'bags'
    shutil.copytree(fleet_bags, copied)
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


@pytest.mark.long
def test_what_was_written_before_an_interruption_is_not_done_again(
    fleet_bags: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lot, whole = fleet_bags / 'lot=A', engine.outcomes

    def interrupted(*arguments: object) -> object:
        yield next(whole(*arguments))  # type: ignore[arg-type]
        raise KeyboardInterrupt

    monkeypatch.setattr(engine, 'outcomes', interrupted)
    with pytest.raises(KeyboardInterrupt):
        run([lot], tmp_path)
    monkeypatch.setattr(engine, 'outcomes', whole)
    after = run([lot], tmp_path, 2)
    assert (after.unchanged, after.estimated) == (1, 1)
    rows = FleetTable(tmp_path).rows("SELECT count(*) FROM results WHERE role = 'fitted'")
    assert rows == [(18,)]


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


@pytest.mark.long
def test_a_scheduler_without_workers_or_with_others_software_is_refused(
    fleet_bags: Path, tmp_path: Path, site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, 'CONNECT_TIMEOUT_S', 1.0)
    with (
        pytest.raises(UserError, match='it has no workers; start `dask worker tcp://'),
        connected(Cluster(site(0).address)),
    ):
        pass
    address = site(1).address
    with connected(Cluster(address)) as client:
        (rows,) = outcomes(client, find_devices([f'{fleet_bags}/lot=B']), EstimateSettings())
        assert {row['device'] for row in rows} == {'B00003'}
    monkeypatch.setattr(engine, '_here', lambda: '9.9')
    with (
        pytest.raises(UserError, match=r'has version .*, here is 9\.9'),
        connected(Cluster(address)),
    ):
        pass


@pytest.mark.long
def test_a_cluster_that_grows_is_given_more_devices(
    fleet_bags: Path, site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, 'TASKS_PER_WORKER', 1)
    here, submitted = site(1), []
    with connected(Cluster(here.address)) as client:
        submit = client.submit

        def counted(*arguments: object, **options: object) -> object:
            submitted.append(arguments)
            return submit(*arguments, **options)

        monkeypatch.setattr(client, 'submit', counted)
        rows = outcomes(client, find_devices([str(fleet_bags)]), EstimateSettings())
        next(rows)
        assert len(submitted) == 1
        here.cluster.adapt(minimum=2, maximum=2, interval='100ms')
        client.wait_for_workers(2, timeout=60)
        next(rows)
        assert len(submitted) == 3
        assert len(list(rows)) == 1


@pytest.mark.long
def test_a_scheduler_that_goes_away_is_said_in_one_line(fleet_bags: Path, site) -> None:
    here = site(1)
    with connected(Cluster(here.address)) as client:
        rows = outcomes(client, find_devices([str(fleet_bags)]), EstimateSettings())
        next(rows)
        here.cluster.close()
        with pytest.raises(UserError, match='the scheduler has gone'):
            list(rows)


def copied(fleet_bags: Path, device: str, target: Path) -> Path:
    shutil.copytree(fleet_bags / device, target)
    return target


@pytest.mark.long
def test_a_device_that_was_given_twice_or_moved_has_one_estimate(
    fleet_bags: Path, tmp_path: Path
) -> None:
    first = copied(fleet_bags, 'lot=A/A00001', tmp_path / 'in' / 'A00001')
    twin = copied(fleet_bags, 'lot=A/A00001', tmp_path / 'in' / 'twin')
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


def test_results_that_cannot_be_read_or_written_are_one_line(
    fleet_bags: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    (out / 'results' / 'lot=A').mkdir(parents=True)
    (out / 'results' / 'lot=A' / 'part-1.parquet').write_bytes(b'torn')
    assert main(['fleet', str(fleet_bags), '-o', str(out)]) == 2
    line = capsys.readouterr().err
    assert 'part-1.parquet' in line
    assert 'delete the file' in line
    blocked = tmp_path / 'blocked'
    blocked.mkdir()
    (blocked / 'results').write_text('a file')
    with pytest.raises(UserError, match='what is written is not done twice'):
        run([fleet_bags / 'lot=B'], blocked)
