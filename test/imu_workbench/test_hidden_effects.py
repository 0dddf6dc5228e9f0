# SPDX-License-Identifier: Apache-2.0
"""Effects hidden in the simulated device, in its own finer form, are named; nulls stay quiet."""

import pytest
from imu_workbench.experiment_hidden import Secret, practice_campaign
from thermal_comp.diagnose import diagnose

EFFECTS = (
    'thermal_hysteresis',
    'scale_factor_temperature',
    'g_sensitivity_temperature',
    'heater_hard_iron',
    'vibration_rectification',
    'humidity',
    'warm_up',
    'bias_temperature_curvature',
)


@pytest.mark.parametrize('name', EFFECTS)
def test_hidden_effect_is_named(name: str) -> None:
    recordings, (truth,) = practice_campaign([Secret(name, 3.0)], seed=11, mean_s=20.0)
    diagnosis = diagnose(recordings)
    acted = [f for f in diagnosis.findings if f.kind != 'noise']
    assert [f.name for f in acted] == [name]
    assert acted[0].sensor == truth.sensor
    assert acted[0].error_after < 1.1 * acted[0].noise_floor < acted[0].error_before


def test_law_beyond_the_catalogue_is_not_given_a_name() -> None:
    recordings, _ = practice_campaign([Secret('ageing_slope', 3.0)], seed=13, mean_s=20.0)
    (finding,) = [f for f in diagnose(recordings).findings if f.kind != 'noise']
    assert (finding.kind, finding.name) == ('unexplained', None)
    assert finding.depends_on in {'time', 'temperature'}


def test_heater_that_was_not_logged_is_suspected() -> None:
    recordings, _ = practice_campaign([Secret('unlogged_heater', 3.0)], seed=14, mean_s=20.0)
    (finding,) = [f for f in diagnose(recordings).findings if f.kind != 'noise']
    assert (finding.kind, finding.depends_on) == ('unlogged', 'heater')


@pytest.mark.parametrize('bias_instability', [0.5, 1.0, 2.0])
def test_nothing_hidden_raises_no_alarm(bias_instability: float) -> None:
    recordings, _ = practice_campaign([], seed=21, mean_s=20.0, bias_instability=bias_instability)
    assert [f for f in diagnose(recordings).findings if f.kind != 'noise'] == []
