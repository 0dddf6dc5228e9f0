# SPDX-License-Identifier: Apache-2.0
"""A growing model names what was hidden, in ten lines at most, with errors in degrees too."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_workbench.report.html.diagnosis import growth_section
from imu_workbench.report.model_growth import ModelGrowthTask
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.temperature_rate import TemperatureRate

from imu_recording import write_bag


@pytest.fixture(scope='module')
def bag(run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A device whose accelerometer also feels how fast the temperature changes."""
    folder = tmp_path_factory.mktemp('growth')
    recording = run(rate_hz=0.2)
    rate = np.diff(recording.temperature, prepend=recording.temperature[0]) * 0.2
    error = 0.2 * np.outer(rate, [1.0, -0.7, 0.5])
    moved = replace(recording, linear_acceleration=recording.linear_acceleration + error)
    write_bag(moved, folder / 'z')
    return folder / 'z'


@pytest.fixture(scope='module')
def growth(bag: Path):
    return ModelGrowthTask([bag]).run()


@pytest.mark.long
def test_an_effect_of_the_users_own_is_named(bag: Path) -> None:
    own = type('OwnRate', (TemperatureRate,), {'name': 'own_rate'})
    catalogue = {'bias_temperature': BiasTemperature, 'own_rate': own}
    found = ModelGrowthTask([bag], catalogue).run()
    assert [finding['name'] for finding in found['findings']] == ['own_rate']
    assert found['steps'][0]['added'] == 'own_rate'


def test_the_hidden_effect_is_named_and_removed(growth) -> None:
    assert growth['steps'][0]['sensor'] == 'accelerometer'
    # In this chamber die minus air is the die's rate: the two are one effect. The rate is that of
    # the row before, a flaw that was taken for a second effect.
    (finding,) = growth['findings']
    assert finding['name'] in {'temperature_rate', 'thermal_gradient'}
    assert [step['added'] for step in growth['steps']] == [finding['name']]
    part = growth['sensors']['accelerometer']
    errors = [step['error'] for step in part['steps']]
    assert errors[0] > errors[1] > 2.0 * errors[-1]
    assert errors[-1] < 1.3 * part['floor']
    worst = max(max(row) for row in part['maps']['before']['ratio'])
    left = max(max(row) for row in part['maps']['after']['ratio'])
    assert worst > 2.0
    assert left < 2.0


def test_it_is_told_in_ten_lines_with_degrees_of_both_filters(growth) -> None:
    lines = growth['lines']
    assert len(lines) <= 10
    told = '\n'.join(lines)
    for part in ('fails here', 'missing', 'added', 'm/s²', 'complementary', 'AHRS', 'noise floor'):
        assert part in told
    for row in growth['degrees']:
        assert len(row['sigma']) == len(growth['versions'])
        assert row['sigma'][0] > row['sigma'][-1]


def test_the_page_shows_it(growth) -> None:
    section = growth_section({'growth': growth})
    assert section is not None
    assert set(section.figures) == {'map|accelerometer', 'stairs|growth'}
    maps = section.figures['map|accelerometer']
    assert maps['layout']['coloraxis']['cmax'] == 1.0  # one fixed scale, before and after
    assert [m['coloraxis'] for m in maps['data'] if 'coloraxis' in m] == ['coloraxis', 'coloraxis']
    assert growth_section({'growth': None}) is None
