# SPDX-License-Identifier: Apache-2.0
"""Two effects that one run cannot tell apart: the next experiment, versions, the report."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chamber_profile.profile.file import load_profile

from imu_recording import read_bag, write_bag

from .conftest import Server, servers

ROOT = Path(__file__).resolve().parents[2]
RATE = 2e-4
"""What is hidden follows the temperature's rate [m/s² per °C/min], or a gradient: it is small."""


@pytest.fixture(scope='module')
def ambiguous(tmp_path_factory) -> Path:
    """One run of an accelerometer whose error follows the rate of its temperature."""
    recording = read_bag(ROOT / 'bags' / 'hidden_effect_x')
    rng = np.random.default_rng(1)
    rate = np.gradient(recording.temperature, recording.time) * 60.0
    values = np.outer(recording.temperature - 20.0, [2e-3, -1e-3, 3e-3]) + RATE * rate[:, None]
    values += [9.81, 0.0, 0.0] + rng.normal(0.0, 7e-4, values.shape)
    unknown = np.full(values.shape, np.nan)
    path = tmp_path_factory.mktemp('bags') / 'ambiguous_x'
    changed = replace(
        recording, linear_acceleration=values, angular_velocity=unknown, magnetic_field=unknown
    )
    write_bag(changed, path)
    return path


@pytest.fixture(scope='module')
def server(ambiguous) -> Iterator[Server]:
    with servers() as start:
        yield start(ambiguous)


def test_an_ambiguous_pair_offers_an_experiment(server, watch, tmp_path):
    watched = watch(server.address)
    page = watched.page
    page.locator('.tile.bad').first.wait_for()
    page.get_by_role('tab', name='Learn').click()
    page.get_by_role('button', name='Diagnose').click()
    page.locator('.finding').first.wait_for()
    page.get_by_role('button', name=re.compile('^Next experiment: or ')).first.click()
    page.get_by_role('heading', name='Next experiment', exact=True).wait_for()
    plot = page.locator('.js-plotly-plot[aria-label="Set-point of the next experiment"]')
    plot.locator('.ytitle', has_text='set-point [°C]').wait_for()
    with page.expect_download() as saving:
        page.get_by_role('button', name='Save the profile').click()
    file = tmp_path / saving.value.suggested_filename
    saving.value.save_as(file)
    assert len(load_profile(file).run_steps) > 3
    assert server.alive
    watched.check()


def test_versions_are_compared_and_the_report_is_saved(server, watch, tmp_path):
    watched = watch(server.address)
    page = watched.page
    page.locator('.tile.bad').first.wait_for()
    page.get_by_role('tab', name='Add').click()
    page.get_by_role('checkbox', name='temperature rate', exact=True).click()
    page.locator('tr.on', has_text='v2').wait_for()
    page.locator('.tile.good', has_text='Accelerometer').wait_for()
    page.get_by_role('tab', name='Compare').click()
    earlier = page.locator('.legendtext', has_text='residual of the earlier version')
    earlier.wait_for()

    page.get_by_role('tab', name='Add').click()
    page.get_by_role('combobox', name='Compare with').click()
    page.get_by_role('option', name='nothing').click()
    page.get_by_role('option').first.wait_for(state='detached')  # the list fades for a moment
    page.get_by_role('combobox', name='Show').click()
    page.get_by_role('option', name='v1').click()
    page.locator('tr.on', has_text='v1').wait_for()
    page.locator('.tile.bad', has_text='Accelerometer').wait_for()
    page.get_by_role('tab', name='Compare').click()
    page.locator('.place').first.wait_for()
    earlier.wait_for(state='detached')

    page.get_by_role('tab', name='Add').click()
    page.get_by_role('combobox', name='Show').click()
    page.get_by_role('option', name='v2').click()
    page.locator('tr.on', has_text='v2').wait_for()
    with page.expect_download() as saving:
        page.get_by_role('button', name='Save the report').click()
    file = tmp_path / 'report.html'
    saving.value.save_as(file)
    reader = watch(file.as_uri())
    reader.page.locator('#diagnosis-title').wait_for()
    reader.page.get_by_text('history of the model').first.wait_for()
    assert 'temperature rate' in reader.page.locator('#model').inner_text()
    reader.page.locator('#diagnosis').scroll_into_view_if_needed()
    reader.page.locator('#diagnosis .js-plotly-plot .main-svg').first.wait_for()
    reader.check()
    watched.check()
