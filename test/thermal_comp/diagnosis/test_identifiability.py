# SPDX-License-Identifier: Apache-2.0
"""One warming sweep in one pose: what it leaves open is said, and nothing recommended blindly."""

import json

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.diagnosis.result import Diagnosis

from imu_recording import ImuRecording

RATE_HZ = 2.0
NOISE = {'linear_acceleration': 5e-3, 'angular_velocity': 9e-4, 'magnetic_field': 4e-7}
LEVEL = {
    'linear_acceleration': [0.1, -0.2, 9.8],
    'angular_velocity': [0.01, 0.0, -0.02],
    'magnetic_field': [2e-5, 0.0, -4e-5],
}


def sweep(seed: int, bend: float) -> ImuRecording:
    """Return 40 min of warming from −10 °C; the accelerometer's z axis bends by `bend` [m/s²]."""
    rng = np.random.default_rng(seed)
    n = int(2400 * RATE_HZ)
    time = np.arange(n) / RATE_HZ
    temperature = 25.0 - 35.0 * np.exp(-time / 900.0)
    measured = {}
    for name, level in LEVEL.items():
        slope = rng.normal(0.0, 2.0, 3) * NOISE[name]
        error = np.multiply.outer(temperature - 20.0, slope)
        measured[name] = level + error + rng.normal(0.0, NOISE[name], (n, 3))
    measured['linear_acceleration'][:, 2] += bend * ((temperature - 8.0) / 17.0) ** 2
    stamp = np.round(time * 1e9).astype(np.int64)
    return ImuRecording(
        stamp=stamp, temperature=temperature, device='board', up_axis='+z', **measured
    )


@pytest.fixture(scope='module', params=[0.0, pytest.param(0.06, marks=pytest.mark.long), 0.1])
def diagnosis(request: pytest.FixtureRequest) -> tuple[float, Diagnosis]:
    return request.param, diagnose([sweep(3, request.param)])


def test_what_cannot_be_decided_is_said_in_words_and_in_json(
    diagnosis: tuple[float, Diagnosis],
) -> None:
    undecided = diagnosis[1].undecided
    pairs = {pair.between for pair in undecided}
    assert ('bias_temperature', 'scale_factor_temperature') in pairs
    assert ('bias_temperature_curvature', 'thermal_lag') in pairs
    assert any('one warming sweep' in pair.text for pair in undecided)
    content = json.loads(json.dumps(diagnosis[1].to_dict()))
    assert len(content['undecided']) == len(undecided)


def test_nothing_is_recommended_that_foresees_less_than_the_line(
    diagnosis: tuple[float, Diagnosis],
) -> None:
    bend, found = diagnosis
    effects = [f for f in found.findings if f.kind == 'effect']
    for finding in effects:
        assert finding.error_before is not None
        assert finding.error_after is not None
        assert finding.error_after <= finding.error_before
    if not bend:
        assert not effects
    else:
        assert found.sensors['accelerometer'].verdict != 'complete'
