# SPDX-License-Identifier: Apache-2.0
"""Whoever looks at a device is answered before the others."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest
from imu_workbench.web.work import answer_order
from imu_workbench.web.work.answer_order import AnswerOrder

DEVICES = ['dut1', 'dut2', 'dut3']


class Answers:
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


def run(scene: Callable[[Answers], Awaitable[None]]) -> list[str]:
    """What was begun, in order, in a scene during which no answer ends before `let_go`."""

    async def play() -> list[str]:
        answers = Answers()
        working = asyncio.ensure_future(answers.prepare_all())
        await scene(answers)
        answers.let_go.set()
        await working
        return answers.begun

    return asyncio.run(play())


def test_the_device_looked_at_has_its_answer_before_another_is_begun() -> None:
    async def looks_at_the_third(answers: Answers) -> None:
        answers.order.look('a tab', 'dut3')
        await settle()
        assert answers.begun == ['prepare dut3', 'answer dut3']

    assert len(run(looks_at_the_third)) == 2 * len(DEVICES)


def test_before_anybody_looks_the_first_goes_first_and_a_later_look_is_heeded() -> None:
    async def looks_later(answers: Answers) -> None:
        await settle()
        assert answers.begun == ['prepare dut1', 'answer dut1']
        answers.order.look('a tab', 'dut2')
        await settle()
        assert answers.begun[2:] == ['prepare dut2', 'answer dut2']
        answers.order.leave('a tab')

    assert len(run(looks_later)) == 2 * len(DEVICES)


def test_no_more_devices_than_cores_that_nobody_looks_at(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(answer_order, 'CORES', 2)

    async def looks_elsewhere(answers: Answers) -> None:
        answers.order.look('a tab', 'one that is not open')
        await settle()
        assert len([told for told in answers.begun if told.startswith('answer')]) == 2

    assert len(run(looks_elsewhere)) == 2 * len(DEVICES)
