# SPDX-License-Identifier: Apache-2.0
"""Whatever a user gives it, the page says what is wrong and what to do, and goes on."""

from __future__ import annotations

import re
import shutil
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imu_recording import read_bag, write_bag

from .conftest import BAGS, ROOT

EFFECT = """
from dataclasses import dataclass

import numpy as np
from thermal_comp.effects import Effect, shape_parameter


@dataclass(frozen=True)
class Kink(Effect):
    \"\"\"The slope changes at one temperature.\"\"\"

    kink: float = shape_parameter(10.0, unit='°C', bounds=(-5.0, 40.0))
    name = 'kink'
    equation = 'error = a · max(0, T − T_k)'
    coefficient_units = ('{unit}/K',)
    mechanism = 'A contact opens.'
    separation = 'Compare the slopes on both sides.'
    typical_size = 'unknown'
    reference = 'none'

    def columns(self, conditions, state=None):
        return np.maximum(0.0, conditions.temperature - self.kink)[:, None], None
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory) -> Path:
    """Bags in a folder of their own, one damaged."""
    place = tmp_path_factory.mktemp('root')
    for bag in BAGS:
        shutil.copytree(bag, place / bag.name)
    shutil.copytree(BAGS[0], place / 'damaged')
    shutil.copytree(ROOT / 'bags' / 'dut1_motion', place / 'dut1_motion')
    cold = read_bag(BAGS[0])
    write_bag(replace(cold, temperature=np.full(len(cold), np.nan)), place / 'without_temperature')
    for file in (place / 'damaged').glob('*.mcap'):
        file.write_bytes(b'not a bag at all' * 100)
    return place


def open_path(page, path: str) -> None:
    if not page.locator('.dialog').count():
        page.get_by_role('button', name='Open bags').click()
    page.get_by_label('or a path below it').fill(path)
    press_open(page)


def press_open(page) -> None:
    page.locator('.dialog').get_by_role('button', name='Open', exact=True).click()
    page.locator('.dialog').wait_for(state='detached')


@pytest.mark.long
def test_bags_that_cannot_be_opened_are_explained(serve, watch, folder):
    server = serve('--root', folder)
    watched = watch(server.address)
    page = watched.page
    page.get_by_text('hidden_effect_x').wait_for()
    open_path(page, 'nowhere')
    page.locator('.message', has_text='nowhere: no such file or folder').wait_for()
    open_path(page, '../..')
    page.locator('.message', has_text='start the server with a --root').wait_for()
    (folder / 'link').symlink_to(ROOT / 'bags' / 'dut1_x')
    open_path(page, 'link')
    page.locator('.message', has_text='link: outside').wait_for()
    open_path(page, 'damaged')
    page.locator('.message', has_text='damaged').wait_for()
    open_path(page, 'dut1_motion')
    page.locator('.message', has_text='dut1_motion is left out: the device moves').wait_for()
    page.get_by_text('Nothing to look at yet').first.wait_for()
    open_path(page, 'without_temperature')
    told = 'without_temperature: dut2_x: no sample has a die temperature'
    page.locator('.message', has_text=told).wait_for()

    page.get_by_role('button', name='Open bags').click()
    for bag in BAGS:
        page.get_by_role('checkbox', name=bag.name).click()
    press_open(page)
    page.locator('.tile.bad').first.wait_for()
    page.locator('.alert', has_text='it is left out').wait_for()
    page.get_by_text('3 runs').wait_for()
    assert server.alive
    watched.check()


@pytest.mark.long
def test_bad_models_and_effects_are_explained(serve, watch, small_bags, tmp_path):
    bag = small_bags / 'dut2_x'
    server = serve(bag, answered=[bag])
    watched = watch(server.address)
    page = watched.page
    page.locator('.verdict:not(.waiting) .sentence').wait_for()
    page.locator('.tree-row.on', has_text='v1').wait_for()
    with page.expect_download() as saving:
        page.get_by_role('button', name='Save the model').click()
    model = tmp_path / 'other.yaml'
    text = Path(saving.value.path()).read_text('utf-8')
    model.write_text(text.replace('device: dut2', 'device: dut9'), 'utf-8')
    upload(page, 'Open a model', model)
    page.locator('.message', has_text='the model is of dut9').wait_for()
    model.write_text('nonsense: [', 'utf-8')
    upload(page, 'Open a model', model)
    page.locator('.message', has_text='not a YAML file').wait_for()
    page.locator('.tree-row.on', has_text='v1').wait_for()

    effect = tmp_path / 'my_effect.py'
    effect.write_text('def broken(:\n', 'utf-8')
    upload(page, 'Load an effect file', effect)
    page.locator('.message', has_text='cannot be loaded').wait_for()
    effect.write_text(EFFECT.replace("('{unit}/K',)", '()'), 'utf-8')
    upload(page, 'Load an effect file', effect)
    page.locator('.message', has_text='coefficient_units is empty').wait_for()
    effect.write_text(EFFECT, 'utf-8')
    upload(page, 'Load an effect file', effect)
    page.locator('.message', has_text='kink can be added now').wait_for()
    page.locator('.verdict:not(.waiting) .sentence').wait_for()
    page.locator('.other, .candidate', has_text='kink').first.wait_for()
    further = page.locator('.further')
    if further.get_attribute('open') is None:
        further.locator('summary').click()
    page.locator('.other, .candidate', has_text='kink').get_by_role(
        'button', name=re.compile('^Add')
    ).click()
    page.locator('.tree-row.on', has_text='+ kink').wait_for()
    page.locator('.version', has_text='v1').click()
    page.locator('.tree-row.on', has_text='v1').wait_for()
    assert server.alive
    watched.check()


def upload(page, label: str, file: Path) -> None:
    with page.expect_file_chooser() as choosing:
        page.get_by_role('button', name=label).click()
    choosing.value.set_files(file)


@pytest.mark.long
def test_a_port_in_use_is_said_on_the_command_line():
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        command = [sys.executable, '-m', 'imu_workbench', 'serve', '--port', str(port)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 2
    assert 'choose another with --port' in done.stderr
    assert 'Traceback' not in done.stderr


def test_other_machines_need_the_token(serve, watch):
    everywhere = '0.0.0.0'  # noqa: S104 (what is tested)
    server = serve('--host', everywhere, '--root', ROOT / 'bags')
    address, _, token = server.address.replace(everywhere, '127.0.0.1').partition('?token=')
    refused = watch(address)
    refused.page.get_by_text('asks for its token').wait_for()
    assert refused.page.locator('.bar').count() == 0
    allowed = watch(f'{address}?token={token}')
    allowed.page.get_by_role('button', name='Open bags').wait_for()
    loading = allowed.page.get_by_role('button', name='Load an effect file', include_hidden=True)
    assert loading.is_disabled()  # an effect file is a program
    accepted = allowed.page.locator('input[type=file]').evaluate_all(
        'all => all.map(i => i.accept)'
    )
    assert accepted  # models and statements can be opened
    assert '.py' not in accepted
    allowed.check()
