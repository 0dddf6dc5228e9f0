# SPDX-License-Identifier: Apache-2.0
"""A version is asked about once, and again where recordings or effects changed meanwhile."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest
from imu_workbench.case import case_of_device, found_in
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.work.answers import Answers
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
