# SPDX-License-Identifier: Apache-2.0
"""Cases and recordings of a server, opened and closed."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from imu_workbench.case import (
    Case,
    CaseRecording,
    case_of_device,
    file_state,
    load_case,
    saved,
    with_found,
    with_version,
)
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case.stored_bag import StoredBag
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.workspace import Workspace

ERRORS = {'gyroscope': {'measured': 3.0, 'error': 2.0, 'floor': 1.0}}
FOUND = {'diagnosis': {'verdict': 'complete', 'findings': []}, 'candidates': {}, 'errors': ERRORS}


@pytest.fixture
def case(tmp_path: Path) -> Case:
    """A case whose two bags were diagnosed."""
    recordings = []
    for name in ('a', 'b'):
        bag = tmp_path / 'bags' / f'{name}.mcap'
        bag.parent.mkdir(exist_ok=True)
        bag.write_bytes(b'not read by these tests')
        recordings.append(CaseRecording(str(bag), name, name * 8, 10, True, *file_state(bag)))
    made = case_of_device(tmp_path / 'cases', 'dut2')
    made = saved(replace(made, recordings=tuple(recordings)))
    return with_found(with_version(made, None, 'line per axis', 'model', ERRORS), 'v1', FOUND)


def shown_before_reading(case: Case, *given: Path) -> dict[str, dict[str, Any]]:
    """What a server that starts shows of its devices before any bag is read."""
    workspace = Workspace(
        ResultCache(BagRoot(case.folder.parent.parent), case.folder.parent), case.folder.parent
    )
    shown: dict[str, dict[str, Any]] = {}

    async def no_reading(*_: object) -> list[str]:
        shown.update({name: work.found for name, work in workspace.devices.items()})
        return []

    workspace.open_bags = no_reading  # type: ignore[method-assign]
    asyncio.run(workspace.start(given, ()))
    return shown


def test_the_verdict_of_a_case_is_shown_before_its_bags_are_read_again(case):
    assert shown_before_reading(case) == {'dut2': {'v1': FOUND}}
    bags = [Path(r.source) for r in case.recordings]
    assert shown_before_reading(case, *bags) == {'dut2': {'v1': FOUND}}


def test_a_verdict_on_bags_that_have_changed_is_not_shown(case):
    Path(case.recordings[1].source).write_bytes(b'another recording')
    assert shown_before_reading(case) == {'dut2': {}}


def test_a_server_of_other_bags_shows_no_verdict_of_a_case(case):
    assert shown_before_reading(case, Path(case.recordings[0].source)) == {}


def test_a_server_that_is_killed_while_it_reads_closes_no_recording(case, tmp_path):
    workspace = Workspace(
        ResultCache(BagRoot(case.folder.parent.parent), case.folder.parent), case.folder.parent
    )
    first, second = (recording.source for recording in case.recordings)

    async def read(path: str | Path) -> list[StoredBag]:
        if path == second:  # a long one
            await asyncio.Event().wait()
        return [
            StoredBag(
                folder=tmp_path,
                device='dut2',
                run='a',
                up_axis='+x',
                source=first,
                samples=10,
                duration=1.0,
                notes=(),
            )
        ]

    async def killed() -> None:
        workspace._read = read  # type: ignore[method-assign]
        opening = asyncio.ensure_future(workspace.start((), ()))
        while not workspace.devices or not workspace.devices['dut2'].bags:
            await asyncio.sleep(0.0)
        opening.cancel()

    asyncio.run(killed())
    assert [r.open for r in load_case(case.folder).recordings] == [True, True]
