# SPDX-License-Identifier: Apache-2.0
"""Limits come in the user's units, are decided in SI, and a mistake in them names its place."""

from pathlib import Path

import numpy as np
import pytest
from imu_recording.user_error import UserError
from imu_workbench.report.limits import CoefficientLimit, CoefficientLimits, read_limits

EXAMPLE = Path(__file__).resolve().parents[3] / 'examples' / 'limits.yaml'


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / 'limits.yaml'
    path.write_text(text, 'utf-8')
    return path


def test_units_become_si() -> None:
    limits = read_limits(EXAMPLE)
    bias = limits.of('accelerometer', 'bias')
    assert bias is not None
    assert bias.upper == pytest.approx(0.09 * 9.80665)
    slope = limits.of('gyroscope', 'slope')
    assert slope is not None
    assert slope.unit == 'rad/s/K'
    assert slope.upper == pytest.approx(np.deg2rad(0.01))
    assert limits.of('magnetometer', 'bias') is None


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('limits: {gyroscope: {bias: {upper: 1, unit: mg}}}', "gyroscope.bias: unit 'mg'"),
        ('limits: {gyroscope: {slope: {upper: 1, unit: rad/s}}}', 'one like rad/s/K'),
        ('limits: {gyroscope: {bias: {lower: 2, upper: 1, unit: °/s}}}', 'lower 2 is above'),
        ('limits: {gyroscop: {bias: {upper: 1, unit: °/s}}}', 'did you mean gyroscope?'),
        ('limits: {gyroscope: {bias: {unit: °/s}}}', 'limits.gyroscope.bias'),
        ('limits: {gyroscope: {bias: {upper: 1}}}', "'unit' is a required property"),
        ('limits: [', 'line 1'),
        ('rule: guarded', "'limits' is a required property"),
    ],
)
def test_a_mistake_names_its_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(UserError, match=r'limits\.yaml: ') as caught:
        read_limits(written(tmp_path, text))
    assert said in str(caught.value)


def test_a_one_sided_limit_fails_on_its_side_only(tmp_path: Path) -> None:
    limits = read_limits(
        written(tmp_path, 'limits: {magnetometer: {slope: {upper: 100, unit: nT/K}}}')
    )
    slope = limits.of('magnetometer', 'slope')
    assert slope is not None
    assert slope.decide(-1.0, 1e-9, limits.rule) == 'pass'
    assert slope.decide(1.3e-7, 1e-8, limits.rule) == 'fail'


def test_without_an_uncertainty_the_guarded_rule_decides_nothing() -> None:
    limit = CoefficientLimit(-1.0, 1.0, 'T')
    assert limit.decide(0.0, float('nan'), 'guarded') == 'undecided'
    assert limit.decide(0.0, float('nan'), 'simple') == 'pass'
    assert CoefficientLimits({}).of('gyroscope', 'bias') is None
