# SPDX-License-Identifier: Apache-2.0
"""Effects hidden in the simulated device, in its own finer form, are named; nulls stay quiet.

A campaign hides one in each sensor: what is said of a sensor must not depend on the others.
"""

from dataclasses import replace

import numpy as np
import pytest
from imu_driver.simulation.devices import draw_device
from imu_recording.recording import SENSOR_FIELDS
from imu_workbench.simulate.campaign import Logging
from imu_workbench.simulate.hidden_effect import EffectToHide, hidden_campaign, practice_campaign
from thermal_comp.data.conditions import Sensor
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.diagnosis.evidence.posterior import CREDIBLE_PROBABILITY
from thermal_comp.diagnosis.result import Finding

from imu_recording import ImuRecording

A, G, M = 'accelerometer', 'gyroscope', 'magnetometer'
HIDDEN = (
    {A: 'humidity', G: 'g_sensitivity_temperature', M: 'heater_hard_iron'},
    {A: 'vibration_rectification', G: 'warm_up', M: 'scale_factor_temperature'},
    {A: 'thermal_hysteresis', G: 'bias_temperature_curvature', M: 'thermal_lag'},
    {A: 'icing', G: 'thermal_gradient', M: 'compressor_hard_iron'},
)


def acted_on(recordings: list[ImuRecording]) -> list[Finding]:
    return [f for f in diagnose(recordings).findings if f.kind != 'noise']


def measured_by(recordings: list[ImuRecording], *sensors: str) -> list[ImuRecording]:
    """Return the recordings as of a device that has these sensors alone."""
    others = [field for sensor, field in SENSOR_FIELDS.items() if sensor not in sensors]
    return [replace(r, **{f: np.full((len(r), 3), np.nan) for f in others}) for r in recordings]


@pytest.mark.parametrize(
    'hidden',
    [{A: 'icing'}, *(pytest.param(some, marks=pytest.mark.long) for some in HIDDEN)],
    ids=lambda hidden: ' '.join(hidden.values()),
)
def test_hidden_effects_are_named(hidden: dict[str, str]) -> None:
    hidden_effects = [EffectToHide(name, 3.0, sensor) for sensor, name in hidden.items()]
    recordings, _ = practice_campaign(hidden_effects, seed=11, mean_s=60.0)
    acted = acted_on(recordings)
    named = {hidden[sensor]: sensor for sensor in hidden}
    first = [f for f in acted if named.get(f.name or '') == f.sensor]
    assert len(first) == len(hidden)
    # Another name may stand beside it for what the finer form differs by, but not for certain.
    assert all(f.probability < CREDIBLE_PROBABILITY for f in acted if f not in first)
    for finding in first:
        assert finding.error_after < 1.1 * finding.noise_floor < finding.error_before


@pytest.mark.long
@pytest.mark.parametrize(
    ('law', 'sensor'),
    [('ageing_slope', G), ('mode_crossing', M)],
)
def test_a_law_beyond_the_catalogue_is_not_given_a_name(law: str, sensor: Sensor) -> None:
    recordings, (truth,) = practice_campaign(
        [EffectToHide(law, 3.0, sensor)], seed=13, mean_s=60.0
    )
    (finding,) = acted_on(measured_by(recordings, sensor))
    assert (finding.kind, finding.name) == ('unexplained', None)
    assert finding.depends_on in truth.depends_on


@pytest.mark.long
def test_heater_that_was_not_logged_is_suspected() -> None:
    hidden_effects = [EffectToHide('unlogged_heater', 3.0)]
    recordings, (truth,) = practice_campaign(hidden_effects, seed=14, mean_s=60.0)
    (finding,) = acted_on(measured_by(recordings, truth.sensor))
    assert (finding.kind, finding.depends_on) == ('unlogged', 'heater')


@pytest.mark.parametrize(
    'bias_instability',
    [pytest.param(0.5, marks=pytest.mark.long), 1.0, pytest.param(2.0, marks=pytest.mark.long)],
)
def test_nothing_hidden_raises_no_alarm(bias_instability: float) -> None:
    recordings, _ = practice_campaign([], seed=21, mean_s=20.0, bias_instability=bias_instability)
    findings = diagnose(recordings).findings
    assert [f for f in findings if f.kind != 'noise'] == []
    if bias_instability > 1.0:  # and louder noise is found, whatever the rows are
        assert {f.sensor for f in findings} == {A, G, M}


@pytest.mark.long
def test_a_step_that_noise_was_fitted_to_is_named() -> None:
    """Fitted to a step of 13 × noise, white noise vanishes, and what is left has no name."""
    recordings = hidden_campaign(
        'paper_betta2022',
        draw_device(2622),
        Logging(0.05, True, 20.0),
        [EffectToHide('bias_step', 12.9, A)],
        seed=2622,
        orientations=('+x', '+y', '+z'),
    ).recordings
    (finding,) = acted_on(measured_by(recordings, A))
    assert (finding.sensor, finding.name) == (A, 'bias_step')
    assert finding.error_after < 1.1 * finding.noise_floor


@pytest.mark.long
def test_a_drift_beside_a_line_of_many_times_its_size_is_named() -> None:
    """Beside the line there is no slow noise; before it is found there seems to be much."""
    recordings = hidden_campaign(
        'paper_betta2022',
        draw_device(0),
        Logging(1.0 / 60.0, True, 60.0),
        [EffectToHide('mains_alias', 30.0, M), EffectToHide('bias_drift', 2.0, M)],
        seed=0,
        orientations=('+x',),
    ).recordings
    acted = acted_on(measured_by(recordings, M))
    assert {f.name for f in acted} == {'mains_alias', 'bias_drift'}
