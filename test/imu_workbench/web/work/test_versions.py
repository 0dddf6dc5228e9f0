# SPDX-License-Identifier: Apache-2.0
"""Versions are compared with the recordings, and tried again where they could not be."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from imu_workbench.case import RequestedFit, case_of_device, load_case, saved, with_version
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.case import tasks
from imu_workbench.web.work.answers import Answers
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.effect_files import EffectFiles
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.task_runner import TaskRunner
from imu_workbench.web.work.versions import Versions


class Compared(TaskRunner):
    """A runner that finds the same version whatever it is asked; nobody is diagnosed."""

    def __init__(self, folder: Path, opened: tasks.Opened) -> None:
        super().__init__(ResultCache(BagRoot(folder), folder), Notices())
        self.opened: tasks.Opened | None = opened
        self.asked: list[Sequence[object]] = []
        self.meanwhile: Callable[[], None] = lambda: None

    async def run(self, about: str, key: object, task: object, *_arguments: object) -> object:
        if task is tasks.prepare_task:
            return key
        self.asked.append((about, task))
        self.meanwhile()
        return self.opened if task is tasks.version_task else None


def opened(folder: Path, fitted) -> tuple[Versions, Compared, DeviceWork]:
    """The versions of a device whose case holds none."""
    runner = Compared(folder, tasks.Opened(fitted.line, {}, {}, fitted.hashes))
    work = DeviceWork(case_of_device(folder / 'cases', 'dut2'))
    work.take_bags(fitted.bags, runner.cache)
    devices, effects = {'dut2': work}, EffectFiles(runner, folder / 'cases', lambda: None)
    return Versions(devices, effects, Answers(devices, effects, runner), runner), runner, work


def test_a_device_without_a_version_gets_a_line_and_its_case_the_hashes_of_the_runs(
    fitted, tmp_path
):
    versions, _, work = opened(tmp_path, fitted)
    asyncio.run(versions.resume('dut2'))
    case = load_case(work.case.folder)
    assert [v.label for v in case.versions] == ['line per axis']
    assert case.current == 'v1'
    assert {r.run: r.sha256 for r in case.recordings} == fitted.hashes
    assert list(work.loaded) == ['v1']


def test_a_version_whose_file_is_missing_is_said_and_tried_again(fitted, tmp_path):
    versions, runner, work = opened(tmp_path, fitted)
    work.case = with_version(work.case, None, 'line', 'model', fitted.line.errors())
    model = work.case.model_file('v1')
    model.unlink()
    asyncio.run(versions.resume('dut2'))
    assert work.failed == {'v1'}
    assert 'v1.yaml: No such file or directory; put it back' in runner.notices.messages[0].text
    assert runner.asked == []
    model.write_text('model', 'utf-8')
    versions.try_again('dut2', 'v1')
    assert work.failed == set()
    asyncio.run(versions.load('dut2', 'v1'))
    assert work.loaded['v1'].model_text == fitted.line.model_text


def test_a_version_is_compared_with_the_recordings_that_are_open_by_then(fitted, tmp_path):
    versions, runner, work = opened(tmp_path, fitted)
    work.case = with_version(work.case, None, 'line', 'model', fitted.line.errors())

    def close_one() -> None:
        runner.meanwhile = lambda: None
        work.take_bags(fitted.bags[:2], runner.cache)

    runner.meanwhile = close_one
    asyncio.run(versions.load('dut2', 'v1'))
    compared = [about for about, task in runner.asked if task is tasks.version_task]
    assert compared == ['dut2 v1'] * 2

    runner.meanwhile = lambda: work.take_bags([], runner.cache)
    work.loaded = {}
    asyncio.run(versions.load('dut2', 'v1'))
    assert (work.loaded, work.failed) == ({}, set())


def test_a_fit_keeps_the_runs_it_was_made_of(fitted, tmp_path):
    versions, runner, work = opened(tmp_path, fitted)
    work.case = with_version(work.case, None, 'line', 'model', fitted.line.errors())

    async def computed(*_: object) -> object:
        work.take_bags(fitted.bags[:2], runner.cache)
        return fitted.lag

    runner.cache.compute = computed  # type: ignore[method-assign]

    async def fit() -> None:
        versions.queue.request('dut2', 'v1', tasks.Change('thermal_lag'))
        while versions.queue.fits:
            await asyncio.sleep(0.0)

    asyncio.run(fit())
    assert work.case.versions[-1].recordings == tuple(bag.run for bag in fitted.bags)
    assert 'v2' not in work.loaded  # compared with others, it is not what it was fitted to


def test_a_first_comparison_that_came_to_nothing_is_tried_again(fitted, tmp_path):
    versions, runner, work = opened(tmp_path, fitted)
    found, runner.opened = runner.opened, None

    async def again() -> None:
        await versions.resume('dut2')
        assert work.failed == {''}
        runner.opened = found
        versions.try_again('dut2', '')
        await asyncio.gather(*runner.background)

    asyncio.run(again())
    assert [v.name for v in work.case.versions] == ['v1']


def test_a_fit_that_a_killed_server_left_is_queued_once_for_the_tab_that_asked(fitted, tmp_path):
    versions, _, work = opened(tmp_path, fitted)
    left = RequestedFit('v1', 'thermal_lag', ('accelerometer',), tab='17')
    case = with_version(work.case, None, 'line', 'model', fitted.line.errors())
    work.case = saved(replace(case, requested=(left,)))

    async def restarted() -> None:
        await versions.resume('dut2')
        await versions.resume('dut2')  # as another recording is opened
        (fit,) = versions.queue.fits
        assert (fit.base, fit.change.effect, fit.tab) == ('v1', 'thermal_lag', '17')
        assert load_case(work.case.folder).requested == (left,)

    asyncio.run(restarted())
