# SPDX-License-Identifier: Apache-2.0
"""The way of a user: see the model fail, read what is missing, add it, save, confirm."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

BAGS = [Path(f'bags/hidden_effect_{axis}') for axis in 'xyz']
ROOT = Path(__file__).resolve().parents[2]


def number_of(text: str) -> float:
    """First number of a text as the page shows numbers."""
    first = text.split(maxsplit=1)[0]
    return float(first.replace('−', '-').replace('\N{NARROW NO-BREAK SPACE}', ''))


def click_cell(page, column: int, row: int) -> None:
    """Click the map of where it fails: 17 columns of three runs, a row for each of 7 phases."""
    cells = page.locator('.wide .card').nth(1).locator('.nsewdrag')
    box = cells.bounding_box()
    cells.click(
        position={
            'x': (column + 0.5) * box['width'] / 17,
            'y': (row + 0.5) * box['height'] / 7,
        }
    )


def compared_by_command(model: Path, answer: Path) -> tuple[float, float]:
    """Held-out error and noise floor of the accelerometer as `compare` says, over the axes."""
    command = [sys.executable, '-m', 'imu_workbench', 'compare', *map(str, BAGS)]
    subprocess.run(
        [*command, '--model', model, '--json', answer], check=True, cwd=ROOT, capture_output=True
    )
    part = json.loads(answer.read_text('utf-8'))['sensors']['accelerometer']
    error, floor = (
        (sum(value**2 for value in part[key]) / 3.0) ** 0.5
        for key in ('held_out_rms', 'noise_floor')
    )
    return error, floor


def test_a_user_finds_adds_and_saves_the_hidden_effect(serve, watch, tmp_path):
    server = serve(*BAGS)
    watched = watch(server.address)
    page = watched.page

    # Compare: the worst place is a ramp, in the accelerometer.
    accelerometer = page.locator('.tile', has_text='Accelerometer')
    page.locator('.tile.bad').first.wait_for()
    assert accelerometer.get_attribute('aria-pressed') == 'true'
    worst = page.locator('.place').first
    worst.wait_for()
    assert 'ramp' in worst.inner_text()
    before = number_of(accelerometer.locator('.tile-value').inner_text())
    worst.click()
    page.locator('.place.on').wait_for()
    click_cell(page, column=4, row=3)
    page.locator('.legendtext', has_text='dut2_x, ramp up, cycle 4').first.wait_for()

    # Learn: it is named, with evidence, and explained.
    page.get_by_role('tab', name='Learn').click()
    page.get_by_role('button', name='Diagnose').click()
    finding = page.locator('.finding').first
    finding.wait_for()
    name = finding.locator('h3').inner_text()
    assert 'thermal lag' in name
    assert 'evidence' in finding.inner_text()
    assert 'noise floor' in finding.inner_text()
    page.locator('.preview .js-plotly-plot .main-svg').first.wait_for()

    # Add: the error falls to the floor.
    finding.get_by_role('button', name='Add to the model').click()
    page.locator('.tile.good', has_text='Accelerometer').wait_for()
    after = number_of(accelerometer.locator('.tile-value').inner_text())
    assert after < 0.2 * before
    page.get_by_role('tab', name='Add').click()
    page.locator('tr.on', has_text='thermal lag').wait_for()

    # Save: the command line says the same of the file.
    with page.expect_download() as saving:
        page.get_by_role('button', name='Save the model').click()
    model, answer = tmp_path / 'model.yaml', tmp_path / 'answer.json'
    saving.value.save_as(model)
    error, floor = compared_by_command(model, answer)
    assert error <= 1.05 * floor
    assert after == pytest.approx(error, rel=1e-2)
    assert server.alive
    watched.check()
