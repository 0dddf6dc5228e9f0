# SPDX-License-Identifier: Apache-2.0
"""A version is asked about once, again where recordings or effects changed; which device first."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from imu_workbench.case import case_of_device, found_in
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.work import answers as answers_module
from imu_workbench.web.work.answers import AnswerOrder, Answers
from imu_workbench.web.work.device_work import DeviceWork
from imu_workbench.web.work.effect_files import EffectFiles
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.task_runner import TaskRunner

ERRORS = {'gyroscope': {'measured': 3.0, 'error': 2.0, 'floor': 1.0}}


class Asked(TaskRunner):
    """A runner that answers with the number of effect files it was asked with."""

    def __init__(self, folder: Path) -> None:
        super().__init__(ResultCache(BagRoot(folder), folder), Notices())
        self.asked: list[int] = []
        self.meanwhile = lambda: None

    async def run(self, _about: str, _key: object, _task: object, *arguments: object) -> dict:
        files = arguments[-1]
        self.asked.append(len(files))
        if len(self.asked) == 1:
            self.meanwhile()
        return {'diagnosis': {'findings': [], 'files': len(files)}, 'candidates': {}}


@pytest.fixture
def work(tmp_path) -> DeviceWork:
    work = DeviceWork(case_of_device(tmp_path / 'cases', 'dut2'))
    work.loaded['v1'] = SimpleNamespace(model_text='model', effects={}, errors=lambda: ERRORS)
    return work


async def asked(answers: Answers) -> None:
    answers.ask('dut2', 'v1')
    answers.ask('dut2', 'v1')
    assert answers.is_diagnosing('dut2', 'v1')  # nobody reads that it was not asked
    while answers.is_diagnosing('dut2', 'v1'):
        await asyncio.sleep(0.0)


def test_a_version_is_asked_about_once_and_the_answer_is_on_disk(work, tmp_path):
    runner = Asked(tmp_path)
    answers = Answers({'dut2': work}, EffectFiles(runner, tmp_path, lambda: None), runner)
    asyncio.run(asked(answers))
    asyncio.run(asked(answers))
    assert runner.asked == [0]
    assert work.found['v1']['errors'] == ERRORS
    assert found_in(work.case, 'v1') == work.found['v1']


def test_a_version_is_asked_again_where_effects_came_while_it_was_asked(work, tmp_path):
    runner = Asked(tmp_path)
    effects = EffectFiles(runner, tmp_path, lambda: None)
    answers = Answers({'dut2': work}, effects, runner)

    def load() -> None:
        effects.files = [tmp_path / 'my_effect.py']
        answers.ask_all_anew()  # as loading does

    runner.meanwhile = load
    asyncio.run(asked(answers))
    assert runner.asked == [0, 1]
    assert work.found['v1']['diagnosis']['files'] == 1
    assert found_in(work.case, 'v1') is None  # of an effect that is not there the next time


DEVICES = ['dut1', 'dut2', 'dut3']


class OrderedWork:
    """Devices that are prepared and then answered; notes which, in order."""

    def __init__(self) -> None:
        self.asked: set[str] = set()
        self.begun: list[str] = []
        self.let_go = asyncio.Event()
        self.order = AnswerOrder(lambda: DEVICES, lambda: self.asked)

    async def prepare_all(self) -> None:
        left = list(DEVICES)
        async with asyncio.TaskGroup() as group:
            while left:
                async with self.order.turn(*left) as device:
                    left.remove(device)
                    self.begun.append(f'prepare {device}')
                    self.asked.add(device)
                group.create_task(self.answer(device))

    async def answer(self, device: str) -> None:
        async with self.order.turn(device):
            self.begun.append(f'answer {device}')
            await self.let_go.wait()
            self.asked.remove(device)


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0.0)


def run(scene: Callable[[OrderedWork], Awaitable[None]]) -> list[str]:
    """What was begun, in order, in a scene during which no answer ends before `let_go`."""

    async def play() -> list[str]:
        work = OrderedWork()
        working = asyncio.ensure_future(work.prepare_all())
        await scene(work)
        work.let_go.set()
        await working
        return work.begun

    return asyncio.run(play())


def test_the_device_looked_at_has_its_answer_before_another_is_begun() -> None:
    async def looks_at_the_third(work: OrderedWork) -> None:
        work.order.look('a tab', 'dut3')
        await settle()
        assert work.begun == ['prepare dut3', 'answer dut3']

    assert len(run(looks_at_the_third)) == 2 * len(DEVICES)


def test_before_anybody_looks_the_first_goes_first_and_a_later_look_is_heeded() -> None:
    async def looks_later(work: OrderedWork) -> None:
        await settle()
        assert work.begun == ['prepare dut1', 'answer dut1']
        work.order.look('a tab', 'dut2')
        await settle()
        assert work.begun[2:] == ['prepare dut2', 'answer dut2']
        work.order.leave('a tab')

    assert len(run(looks_later)) == 2 * len(DEVICES)


def test_no_more_devices_than_cores_that_nobody_looks_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(answers_module, 'CORES', 2)

    async def looks_elsewhere(work: OrderedWork) -> None:
        work.order.look('a tab', 'one that is not open')
        await settle()
        assert len([told for told in work.begun if told.startswith('answer')]) == 2

    assert len(run(looks_elsewhere)) == 2 * len(DEVICES)
