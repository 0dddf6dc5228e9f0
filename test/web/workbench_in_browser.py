# SPDX-License-Identifier: Apache-2.0
"""The way of a user who reads nothing: a sentence, preview, add, 1.0 ×, certificate."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from imu_recording import read_bag, write_bag

from .conftest import BAGS, ROOT

MOST_CLICKS = 5


def number_of(text: str) -> float:
    """First number of a text as the page shows numbers."""
    first = text.split(maxsplit=1)[0]
    return float(first.replace('−', '-').replace('\N{NARROW NO-BREAK SPACE}', ''))


def compared_by_command(bags: Sequence[Path], model: Path, answer: Path) -> tuple[float, float]:
    """Held-out error and noise floor of the accelerometer as `compare` says, over the axes."""
    command = [sys.executable, '-m', 'imu_workbench', 'compare', *map(str, bags)]
    subprocess.run(
        [*command, '--model', model, '--json', answer], check=True, cwd=ROOT, capture_output=True
    )
    part = json.loads(answer.read_text('utf-8'))['sensors']['accelerometer']
    error, floor = (
        (sum(value**2 for value in part[key]) / 3.0) ** 0.5
        for key in ('held_out_rms', 'noise_floor')
    )
    return error, floor


@pytest.fixture
def bags(tmp_path: Path) -> list[Path]:
    """A bag of the hidden effect as of a device that has an accelerometer alone."""
    recording = read_bag(BAGS[0])
    unknown = np.full((len(recording), 3), np.nan)
    alone = replace(recording, angular_velocity=unknown, magnetic_field=unknown)
    write_bag(alone, tmp_path / BAGS[0].name)
    return [tmp_path / BAGS[0].name]


def test_the_verdict_comes_by_itself_and_adding_reaches_the_floor(serve, watch, bags, tmp_path):
    server = serve(*bags, by_command=True)
    watched = watch(server.address)
    page = watched.page
    clicks = 0

    def click(name: str) -> None:
        nonlocal clicks
        clicks += 1
        page.locator('.top').get_by_role('button', name=name, exact=True).click()

    page.locator('.job', has_text='left').first.wait_for()  # what it does, how long it takes
    accelerometer = page.locator('.tile', has_text='Accelerometer')
    page.locator('.verdict.missing').wait_for()
    sentence = page.locator('.sentence').inner_text()
    assert re.match(r'Accelerometer fails in ramps, 8\.3 × noise\. Thermal lag, 7\d', sentence)
    assert accelerometer.get_attribute('aria-pressed') == 'true'
    before = number_of(accelerometer.locator('.tile-value').inner_text())
    assert 'ramp' in page.locator('.place').first.inner_text()

    page.locator('.rail[aria-busy=false]').wait_for()
    rival = page.locator('.candidate', has_text='thermal gradient')
    assert 'Why not' in rival.inner_text()
    assert 'million times less probable' in rival.inner_text()

    click('Preview thermal lag')
    page.locator('.legendtext', has_text='thermal lag would explain').first.wait_for()
    assert 'candidate=thermal_lag' in page.url
    click('Add thermal lag')
    page.locator('.tile.good', has_text='Accelerometer').wait_for()
    page.locator('.tree-row.on', has_text='+ thermal lag').wait_for()
    after = number_of(accelerometer.locator('.tile-value').inner_text())
    assert after < 0.2 * before
    assert '(0.99 ×)' in page.locator('.tree-row.on').inner_text()
    page.locator('.verdict.complete').wait_for()
    check_folded_sizes(page)
    with page.expect_download() as saving:
        click('Save the certificate')
    assert saving.value.suggested_filename == 'dut2_v2_certificate.html'
    certificate = Path(saving.value.path()).read_text('utf-8')
    assert 'thermal lag' in certificate
    assert clicks <= MOST_CLICKS

    check_saved_model(page, after, bags, tmp_path)
    assert server.alive
    watched.check()


def check_folded_sizes(page) -> None:
    """How small an effect would have been found does not push the figures off the screen."""
    assert page.locator('[data-plot="error_over_time"]').bounding_box()['y'] < 450
    page.locator('.sizes summary', has_text='m/s² rms').click()
    page.locator('.smallest', has_text='thermal hysteresis').wait_for()


def check_saved_model(page, error_on_page: float, bags: Sequence[Path], folder: Path) -> None:
    """The model that is saved has the error the page says, by the command line."""
    with page.expect_download() as saving:
        page.get_by_role('button', name='Save the model').click()
    model = folder / 'model.yaml'
    saving.value.save_as(model)
    error, floor = compared_by_command(bags, model, folder / 'answer.json')
    assert error <= 1.05 * floor
    assert error_on_page == pytest.approx(error, rel=1e-2)
