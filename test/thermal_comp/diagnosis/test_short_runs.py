# SPDX-License-Identifier: Apache-2.0
"""Runs too short to tell noise, and runs that do not have the same cycles, are no accident."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import Settings, diagnose
from thermal_comp.diagnosis.growth import add_effect, grow
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from thermal_comp.model.values import ModelError

from imu_recording import ImuRecording

from ..campaign import PERIOD, lagging, measured_by, run

LINE = (EFFECTS['bias_temperature'](),)
FEW = {name: EFFECTS[name] for name in ('thermal_lag', 'thermal_hysteresis')}
SETTINGS = Settings(FEW)


def ramp(seconds: float, burst: bool = False) -> list[ImuRecording]:
    """Return part of a ramp in two orientations; a burst is half a minute of every two."""
    found = []
    for seed, up in enumerate(('+x', '+z')):
        whole = run(up, seed=seed, cycles=2)
        since = (whole.stamp - whole.stamp[0]) * 1e-9 - 4800.0
        inside = (since >= 0.0) & (since < seconds)
        found.append(whole.rows(inside & (since % 120.0 < 30.0) if burst else inside))
    return found


@pytest.mark.parametrize(('seconds', 'burst'), [(100, False), (115, False), (400, True)])
def test_what_is_too_short_for_a_diagnosis_is_said_with_the_length_that_would_do(
    seconds: float, burst: bool
) -> None:
    recordings = ramp(seconds, burst)
    assert fit(LINE, recordings).sensors
    runs = prepare(recordings)
    said = 'too short .* blocks of 5 s; 30 are needed .* 2.5 min'
    with pytest.raises(ModelError, match=said):
        diagnose(recordings, catalogue=FEW)
    with pytest.raises(ModelError, match=said):
        grow(None, runs, SETTINGS)
    with pytest.raises(ModelError, match=said):
        add_effect(None, runs, 'thermal_lag', SETTINGS)


@pytest.mark.parametrize(('seconds', 'burst'), [(300, False), (900, True)])
def test_minutes_are_enough_for_an_answer(seconds: float, burst: bool) -> None:
    found = diagnose(ramp(seconds, burst), catalogue=FEW)
    assert {state.verdict for state in found.sensors.values()} == {'complete'}


def test_a_sensor_with_too_few_blocks_is_left_out_of_a_diagnosis_and_named() -> None:
    recordings = [run('+z', cycles=2)]
    recordings[0].magnetic_field[100:] = np.nan
    found = diagnose(recordings, catalogue=FEW)
    assert sorted(found.sensors) == ['accelerometer', 'gyroscope']
    assert any('magnetometer' in note and 'too short' in note for note in found.notes)


def test_an_aborted_run_has_fewer_cycles_than_the_others() -> None:
    recordings = [run('+x', cycles=2), run('+z', seed=1, cycles=3)]
    found = diagnose(recordings, catalogue=FEW)
    assert {state.verdict for state in found.sensors.values()} == {'complete'}


def test_a_step_in_twenty_minutes_is_named_though_no_other_could_be_tried() -> None:
    (recording, _) = ramp(1150.0)
    late = np.arange(len(recording)) >= len(recording) // 2
    shifted = recording.angular_velocity + 3e-3 * late[:, None]
    stepped = replace(recording, angular_velocity=shifted)
    found = diagnose([stepped], catalogue={'bias_step': EFFECTS['bias_step']})
    assert [f.name for f in found.findings if f.sensor == 'gyroscope'][:1] == ['bias_step']


def test_what_takes_minutes_in_a_chamber_is_found_in_seconds_under_a_heat_gun() -> None:
    shorter = 100.0
    whole = run('+z', cycles=1)
    behind = lagging(whole.temperature, 400.0, PERIOD) - whole.temperature
    error = np.outer(behind, [2e-3, -1e-3, 4e-3])
    played = replace(
        whole,
        stamp=whole.stamp[0] + ((whole.stamp - whole.stamp[0]) / shorter).astype(np.int64),
        phase=None,
        cycle=None,
        linear_acceleration=whole.linear_acceleration + error,
    )
    assert played.time[-1] < 110.0
    found = diagnose(measured_by([played], 'accelerometer'), catalogue=FEW)
    (finding,) = [f for f in found.findings if f.kind == 'effect']
    assert finding.name == 'thermal_lag'
    assert finding.parameters['time_constant']['value'] == pytest.approx(400.0 / shorter, rel=0.2)
    assert finding.error_after < 1.2 * finding.noise_floor


@pytest.mark.parametrize('seed', [0, pytest.param(2, marks=pytest.mark.long)])
def test_two_effects_in_one_ramp_are_both_looked_for(seed: int) -> None:
    # Beside no effect, loud slow noise is likelier and explains as much as they do.
    whole = run('+z', seed=seed, cycles=2)
    since = (whole.stamp - whole.stamp[0]) * 1e-9 - 4700.0
    (one,) = measured_by([whole.rows((since >= 0.0) & (since < 1500.0))], 'gyroscope')
    rate = np.gradient(one.temperature, one.time)
    late = np.arange(len(one)) >= 0.6 * len(one)
    error = np.outer(0.05 * rate + 5e-3 * rate.max() * late, [1.0, -0.5, 0.7])
    felt = replace(one, angular_velocity=one.angular_velocity + error)
    names = ('temperature_rate', 'thermal_lag', 'bias_step', 'warm_up')
    found = diagnose([felt], catalogue={name: EFFECTS[name] for name in names}).to_dict()
    assert found['explanations'][0]['names'] == ['bias_step', 'temperature_rate']
