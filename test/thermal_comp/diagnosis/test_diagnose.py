# SPDX-License-Identifier: Apache-2.0
"""Practice campaigns with a known hidden effect come out right."""

import json
from pathlib import Path

import pytest
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.presentation.diagnosis import VERDICTS

from imu_recording import read_bag


@pytest.mark.shared_data
@pytest.mark.parametrize(
    'letter', ['d', *(pytest.param(letter, marks=pytest.mark.long) for letter in 'abce')]
)
def test_practice_campaign_is_named(shared: Path, letter: str) -> None:
    folder = shared / 'campaigns' / f'practice_{letter}'
    truth = json.loads((folder.parent / 'practice_truth.json').read_text())[folder.name]
    diagnosis = diagnose([read_bag(run) for run in sorted(folder.glob('run*'))])
    content = diagnosis.to_dict()
    assert content['schema'] == 2
    assert content['verdict'] in VERDICTS
    if truth['name'] is None:
        assert content['verdict'] == 'complete'
        assert content['findings'] == []
        return
    (finding,) = content['findings']
    assert (finding['kind'], finding['name']) == ('effect', truth['name'])
    assert finding['sensor'] == truth['sensor']
    assert finding['evidence'] > finding['threshold']
    assert finding['error_after'] < 1.05 * finding['noise_floor'] < finding['error_before']
    if truth['name'] == 'thermal_lag':
        fitted = finding['parameters']['time_constant']
        assert abs(fitted['value'] - truth['parameters']['tau']) < 3.0 * fitted['std']
