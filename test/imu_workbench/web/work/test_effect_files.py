# SPDX-License-Identifier: Apache-2.0
"""Effect files are loaded, kept in the cases whose versions need them, and asked for again."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest
from imu_workbench.case import CaseError, case_of_device
from imu_workbench.case_effects import allowed_in, digest, kept_effects
from imu_workbench.web.bag_root import BagRoot
from imu_workbench.web.work.effect_files import EffectFiles
from imu_workbench.web.work.notices import Notices
from imu_workbench.web.work.result_cache import ResultCache
from imu_workbench.web.work.task_runner import TaskRunner

CONTENT = b'NAME = "my_dip"\n'
NEEDS = SimpleNamespace(effects={'gyroscope': ('bias_temperature', 'my_dip')})
"""A version with an effect of the user's own."""


class Loading(TaskRunner):
    """A runner for which each file holds one effect, `my_dip`."""

    async def run(self, _about: str, _key: object, _task: object, files: object) -> dict:
        return {'bias_temperature': {}, 'my_dip': {}} if files else {}


@pytest.fixture
def runner(tmp_path) -> Loading:
    (tmp_path / 'tmp').mkdir()
    return Loading(ResultCache(BagRoot(tmp_path), tmp_path / 'tmp'), Notices())


def opened(runner: TaskRunner, cases: Path, told: list[str]) -> EffectFiles:
    return EffectFiles(runner, cases, lambda: told.append('changed'))


def test_a_case_keeps_the_file_that_a_version_needs_and_a_later_server_asks_for_it(
    runner, tmp_path
):
    told: list[str] = []
    effects, cases = opened(runner, tmp_path / 'cases', told), tmp_path / 'cases'
    case = case_of_device(cases, 'dut2')
    assert asyncio.run(effects.load('my_dip.py', CONTENT)) == ['my_dip']
    assert told == ['changed']
    case, key = effects.kept_for(case, NEEDS), digest(CONTENT)
    assert dict(kept_effects(case)) == {key: 'my_dip.py'}
    assert effects.not_loaded(case) == {}

    later = opened(runner, cases, told)
    assert later.not_loaded(case) == {key: 'my_dip.py'}
    with pytest.raises(CaseError, match=r'v2 needs my_dip\.py, .*load it below'):
        later.check(case, 'v2', f'source: {key[:16]}')
    later.check(case, 'v1', 'a model of the catalogue alone')
    assert allowed_in(cases) == [key]
    asyncio.run(later.load_allowed(case))
    assert later.not_loaded(case) == {}


def test_a_kept_file_that_was_changed_is_not_run(runner, tmp_path):
    effects = opened(runner, tmp_path / 'cases', [])
    asyncio.run(effects.load('my_dip.py', CONTENT))
    case = effects.kept_for(case_of_device(tmp_path / 'cases', 'dut2'), NEEDS)
    (file,) = case.folder.glob('effects/*/*.py')
    file.write_bytes(b'NAME = "another"\n')
    later = opened(runner, tmp_path / 'cases', [])
    asyncio.run(later.load_allowed(case))
    assert later.files == []
    assert 'not the file that was kept' in runner.notices.messages[0].text
