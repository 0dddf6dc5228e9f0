# SPDX-License-Identifier: Apache-2.0
"""Runs the devices of a fleet on Dask, writes what comes back, and goes on after an interruption.

A device is done once its rows stand in a file of results; what was under way when a run ended is
done again. A device whose files, settings and version are those of its rows is left alone.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError

from imu_workbench.fleet.estimate import EstimateSettings, estimate_device, failed_row, version
from imu_workbench.fleet.sources import DeviceSource
from imu_workbench.fleet.table import ResultRow, compact, finished, in_several_places, write_rows

TASKS_PER_WORKER = 4
"""Devices a worker has waiting: enough to be never idle, few enough for a small scheduler."""
FLUSH_S = 2.0
"""Interval of writing results: the work that is lost at most when all is killed [s]."""
MOST_WORKER_DEATHS = 2
"""Workers that may die of one device before it is given up."""
LEAST_MEMORY_BYTES = 100_000_000
"""A worker needs more for the libraries alone [bytes]."""
CONNECT_TIMEOUT_S = 10.0
SCHEDULER_GONE = (
    'the scheduler has gone: start it again and run the same command, it goes on where it was'
)


@dataclass(frozen=True)
class Cluster:
    """Where the work is done."""

    scheduler: str = ''
    """Address of a running scheduler; '' starts workers on this machine."""
    workers: int = 1
    memory: str = '500MB'
    """Limit of each worker on this machine."""
    processes: bool = True


@dataclass
class FleetProgress:
    """What a run has done."""

    devices: int = 0
    """Devices in the sources."""
    unchanged: int = 0
    estimated: int = 0
    failed: dict[str, str] = field(default_factory=dict)
    """Reason by device."""


def run_fleet(
    sources: Sequence[DeviceSource],
    folder: Path,
    settings: EstimateSettings,
    cluster: Cluster,
    *,
    clock: Callable[[], int],
    report: Callable[[str], None] = lambda _: None,
) -> FleetProgress:
    """Estimate every device that is new or has changed; return what was done.

    `clock` gives nanoseconds that increase; `report` takes a line of progress. Raises UserError
    where the scheduler does not answer.
    """
    known = finished(folder)
    refused = _refused(sources)
    todo = [
        source
        for source in sources
        if source.key not in refused
        and known.get(source.key)
        != (source.fingerprint, settings.hash, version(), source.lot, source.type)
    ]
    progress = FleetProgress(len(sources), len(sources) - len(refused) - len(todo))
    rows = [
        failed_row(source, settings, refused[source.key], again=True)
        for source in sources
        if source.key in refused
    ]
    for row in rows:
        progress.failed[row['device']] = row['reason']
    if rows:
        write_rows(folder, rows, clock())
    if todo:
        with connected(cluster) as client:
            _run(client, todo, folder, settings, progress, clock, report)
    _settle_doubles(folder, sources, settings, progress, clock)
    compact(folder)
    return progress


def _refused(sources: Sequence[DeviceSource]) -> dict[str, str]:
    """Return, by source, why a device is not estimated: no bags, or in several folders."""
    names = Counter(source.device for source in sources if source.device)
    twice = {
        source.key: _several(source.device, names[source.device])
        for source in sources
        if names[source.device] > 1
    }
    return twice | {source.key: source.problem for source in sources if source.problem}


def _several(device: str, folders: int) -> str:
    return (
        f'{device} stands in {folders} folders: put its bags into one, or give each device a '
        'name of its own'
    )


def _settle_doubles(
    folder: Path,
    sources: Sequence[DeviceSource],
    settings: EstimateSettings,
    progress: FleetProgress,
    clock: Callable[[], int],
) -> None:
    """Keep one place for each device: results of a former place go, a device in two is refused."""
    given = {source.key: source for source in sources}
    rows: list[ResultRow] = []
    for device, places in in_several_places(folder):
        here = [given[key] for key, _ in places if key in given]
        rows += [
            {'role': 'replaced', 'device': device, 'source': key, 'lot': lot}
            for key, lot in places
            if key not in given
        ]
        if len(here) > 1:  # the device is named in the bag, not in its metadata
            progress.failed[device] = _several(device, len(here))
            progress.estimated -= len(here)
            rows += [
                {**failed_row(one, settings, progress.failed[device], again=True),
                 'device': device}
                for one in here
            ]  # fmt: skip
    if rows:
        write_rows(folder, rows, clock())


def _run(
    client: Any,
    todo: Sequence[DeviceSource],
    folder: Path,
    settings: EstimateSettings,
    progress: FleetProgress,
    clock: Callable[[], int],
    report: Callable[[str], None],
) -> None:
    waiting: list[ResultRow] = []
    flushed = clock()
    try:
        for rows in outcomes(client, todo, settings):
            waiting += rows
            if rows[0]['role'] == 'failed':
                progress.failed[rows[0]['device']] = rows[0]['reason']
            else:
                progress.estimated += 1
            done = progress.estimated + len(progress.failed)
            report(f'{done} of {len(todo)}: {rows[0]["device"]}')
            if (now := clock()) - flushed > FLUSH_S * 1e9:
                write_rows(folder, waiting, now)
                waiting, flushed = [], now
    finally:
        if waiting:
            write_rows(folder, waiting, clock())


def outcomes(
    client: Any, todo: Sequence[DeviceSource], settings: EstimateSettings
) -> Iterator[list[ResultRow]]:
    """Yield the rows of each device as they come: a task a device, a few ahead of the workers."""
    from distributed import as_completed

    left = iter(todo)
    running: dict[str, DeviceSource] = {}
    coming = as_completed()
    fill = partial(_submit_ahead, client, settings, left, running, coming)
    fill()
    for future in coming:
        source = running.pop(future.key)
        if future.status in ('cancelled', 'lost'):
            raise UserError(SCHEDULER_GONE)
        if future.status == 'finished':
            yield future.result()
        else:
            name = type(future.exception()).__name__
            reason = f'{name}: its workers died; where memory ran out, --memory gives them more'
            yield [failed_row(source, settings, reason, again=True)]
        future.release()
        try:
            fill()
        except OSError:
            raise UserError(SCHEDULER_GONE) from None


def _submit_ahead(
    client: Any,
    settings: EstimateSettings,
    left: Iterator[DeviceSource],
    running: dict[str, DeviceSource],
    coming: Any,
) -> None:
    """Submit devices for as many workers as there are now: a cluster may grow and shrink."""
    ahead = TASKS_PER_WORKER * max(1, sum(client.nthreads().values()))
    for source in islice(left, max(0, ahead - len(running))):
        future = client.submit(estimate_device, source, settings, pure=False, retries=1)
        running[future.key] = source
        coming.add(future)


def checked_memory(text: str) -> str:
    """Return a size as it is written; UserError where Dask does not read it as some bytes."""
    from dask.utils import parse_bytes

    try:
        size = parse_bytes(text)
    except ValueError:
        size = 0
    if size < LEAST_MEMORY_BYTES:
        raise UserError(f'--memory {text}: a size from 100MB on, such as 500MB or 2GB')
    return text


@contextmanager
def connected(cluster: Cluster) -> Iterator[Any]:
    """Give a client of the cluster; workers that were started here end with it."""
    import dask
    from distributed import Client, LocalCluster
    from distributed.utils import silence_logging_cmgr

    chosen = {
        'distributed.scheduler.allowed-failures': MOST_WORKER_DEATHS,
        'distributed.comm.timeouts.connect': f'{CONNECT_TIMEOUT_S:g}s',
        'distributed.admin.tick.limit': '1h',
    }
    with dask.config.set(chosen):
        if cluster.scheduler:
            try:
                client = Client(cluster.scheduler, timeout=CONNECT_TIMEOUT_S)
            except (OSError, ValueError) as error:
                raise UserError(
                    f'--scheduler {cluster.scheduler}: no answer ({error}); start one with '
                    '`dask scheduler` and workers with `dask worker ADDRESS`'
                ) from None
            # UserError says it in one line: the client's log would be a traceback.
            with silence_logging_cmgr(logging.CRITICAL), client:
                _check_workers(client, cluster.scheduler)
                yield client
            return
        with (
            LocalCluster(
                n_workers=cluster.workers,
                threads_per_worker=1,
                processes=cluster.processes,
                memory_limit=cluster.memory if cluster.processes else None,
                dashboard_address=None,
                silence_logs=50,
            ) as local,
            Client(local) as client,
        ):
            yield client


def _check_workers(client: Any, scheduler: str) -> None:
    """Raise UserError where a scheduler has no workers, or one of them has other software."""
    try:
        client.wait_for_workers(1, timeout=CONNECT_TIMEOUT_S)
    except TimeoutError:
        raise UserError(
            f'--scheduler {scheduler}: it has no workers; start `dask worker {scheduler} '
            '--nthreads 1` on each host, in the environment of `. ./env.sh`'
        ) from None
    for worker, found in client.run(version, on_error='return').items():
        if found != _here():
            raise UserError(
                f'--scheduler {scheduler}: the worker {worker} has {_software(found)}, here is '
                f'{_here()}: set up the same checkout on each host'
            )


def _here() -> str:
    return version()


def _software(found: Any) -> str:
    return f'no imu_workbench ({found})' if isinstance(found, Exception) else f'version {found}'
