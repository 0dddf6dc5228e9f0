# SPDX-License-Identifier: Apache-2.0
"""Effects of a user's own take part in the report: in its models and in its diagnosis."""

import json
from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.answer import plain
from imu_workbench.commands.report import load_models
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.content import report_content
from imu_workbench.report.html.document import report_page, report_text
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.file import save_model

RIPPLE = """
from dataclasses import dataclass

import numpy as np
from thermal_comp.effects import Effect


@dataclass(frozen=True)
class Ripple(Effect):
    'A reference voltage steps with its own temperature.'

    name = 'ripple'
    equation = 'error = a · sin(2π T / 12 K) + b · cos(2π T / 12 K)'
    coefficient_units = ('{unit}', '{unit}')
    mechanism = 'A reference that is trimmed in steps.'
    separation = 'Look for a period in temperature.'
    typical_size = 'unknown'
    reference = 'none'

    def columns(self, conditions, state=None):
        angle = 2.0 * np.pi * conditions.temperature / 12.0
        return np.column_stack([np.sin(angle), np.cos(angle)]), None
"""


def content_of(recordings, **options):
    analysis = analyse_recordings(recordings, attitudes=False, **options)
    return report_content(analysis, commands=['report'], versions={})


@pytest.mark.long
def test_an_effect_of_the_users_own_is_diagnosed_and_stands_in_models(run, tmp_path) -> None:
    file, path = tmp_path / 'ripple.py', tmp_path / 'model.yaml'
    file.write_text(RIPPLE, 'utf-8')
    clean = run(cycles=2)
    wave = 1e-3 * np.sin(2 * np.pi * clean.temperature / 12.0)
    unknown = np.full((len(clean), 3), np.nan)
    recordings = [
        replace(
            clean,
            angular_velocity=clean.angular_velocity + wave[:, None],
            linear_acceleration=unknown,
            magnetic_field=unknown,
        )
    ]
    catalogue = effect_catalogue([file])
    found = content_of(recordings, catalogue=catalogue)
    named = [f['name'] for f in found['diagnosis']['dut1']['findings'] if f['kind'] == 'effect']
    assert named == ['ripple']
    assert 'ripple' in report_page(found)
    assert '+ ripple' in json.dumps(found['staircase'])
    assert 'ripple' in report_text(found)

    grown = fit_prepared(
        {'gyroscope': (BiasTemperature(), catalogue['ripple']())}, prepare(recordings)
    )
    save_model(grown, path)
    models = load_models([path], catalogue)
    judged = content_of(recordings, models=models, catalogue=catalogue)
    assert judged['diagnosis']['dut1']['verdict'] == 'complete'
    assert 'ripple' in json.dumps(plain(judged['models']))
