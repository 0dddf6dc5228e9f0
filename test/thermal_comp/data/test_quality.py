# SPDX-License-Identifier: Apache-2.0
"""Defects of whole recordings: foreign units, impossible tracks, rails, spikes, start-ups."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.quality import check_quality, check_recording

from imu_recording import ImuRecording

from ..campaign import run

FIELDS = {
    'accelerometer': 'linear_acceleration',
    'gyroscope': 'angular_velocity',
    'magnetometer': 'magnetic_field',
}
RUNS = [run(up, seed=k) for k, up in enumerate(('+x', '+y', '+z'))]


def scaled(
    recording: ImuRecording, sensor: str, factor: float, offset: float = 0.0
) -> ImuRecording:
    """Return the recording with one sensor times a factor, plus an offset on its x axis."""
    values = getattr(recording, FIELDS[sensor]) * factor + np.array([offset, 0.0, 0.0])
    return replace(recording, **{FIELDS[sensor]: values})


@pytest.mark.parametrize(
    ('sensor', 'factor', 'unit'),
    [
        ('accelerometer', 1 / 9.80665, 'g'),
        ('accelerometer', 1e3 / 9.80665, 'mg'),
        ('magnetometer', 1e6, 'µT'),
        ('magnetometer', 1e4, 'gauss'),
        ('gyroscope', 180 / np.pi, '°/s'),
    ],
)
def test_one_run_in_another_unit_is_named_with_it(sensor: str, factor: float, unit: str) -> None:
    clean, found = check_quality([RUNS[0], scaled(RUNS[1], sensor, factor), RUNS[2]])
    assert [(f.name, f.sensor) for f in found] == [('unit_mismatch', sensor)]
    assert f'as if in {unit}' in found[0].text
    assert np.isnan(getattr(clean[1], FIELDS[sensor])).all()


def test_all_runs_in_g_are_found_as_well() -> None:
    found = check_quality([scaled(r, 'accelerometer', 1 / 9.80665) for r in RUNS])[1]
    assert [(f.name, f.sensor) for f in found] == [('unit_mismatch', 'accelerometer')]


@pytest.mark.parametrize(
    ('sensor', 'rail'), [('accelerometer', 19.6), ('accelerometer', 157.0), ('magnetometer', 4e-4)]
)
def test_a_rail_far_from_gravity_is_saturation_and_no_unit(sensor: str, rail: float) -> None:
    recordings = []
    for r in RUNS:
        near = scaled(r, sensor, 1.0, rail - np.quantile(getattr(r, FIELDS[sensor])[:, 0], 0.8))
        values = getattr(near, FIELDS[sensor])
        recordings.append(replace(near, **{FIELDS[sensor]: np.minimum(values, rail)}))
    found = check_quality(recordings)[1]
    assert [(f.name, f.sensor) for f in found] == [('saturation', sensor)]


def test_what_is_stuck_has_no_spikes_at_its_edges() -> None:
    values = RUNS[0].angular_velocity.copy()
    values[500:900] = values[500] + 30.0 * values[:400].std(axis=0)
    found = check_quality([replace(RUNS[0], angular_velocity=values)])[1]
    assert [(f.name, f.sensor) for f in found] == [('stuck_value', 'gyroscope')]


@pytest.mark.parametrize(
    ('period', 'time_constant'), [(5.0, 8.0), (5.0, 60.0), (20.0, 60.0), (20.0, 250.0)]
)
def test_a_start_up_is_found_in_slow_rows_too(period: float, time_constant: float) -> None:
    recording = run(seed=3, period=period, cycles=2)
    fill = 1.0 - 0.5 * np.exp(-recording.time / time_constant)[:, None]
    started = replace(
        recording,
        linear_acceleration=recording.linear_acceleration * fill,
        magnetic_field=recording.magnetic_field * fill,
    )
    assert [f.name for f in check_quality([started])[1]] == ['startup_transient']


@pytest.mark.parametrize(
    ('track', 'value'), [('vibration', -1.0), ('humidity', 24.0), ('supply_voltage', -3.0)]
)
def test_a_track_that_cannot_be_is_named_and_left_out(track: str, value: float) -> None:
    n = len(RUNS[0])
    column = np.full((n, 3) if track == 'vibration' else n, 0.5)
    sound = replace(RUNS[0], **{track: column})
    assert check_quality([sound])[1] == []
    broken = column.copy()
    broken[10:30] = value
    clean, found = check_quality([replace(sound, **{track: broken})])
    assert [(f.name, f.rows) for f in found] == [('impossible_statistic', 20)]
    assert np.isnan(getattr(clean[0], track)[10:30]).all()


@pytest.mark.parametrize('rows', [3000, 40])
def test_what_a_motor_shakes_has_no_spikes_but_the_rest_may_have(rows: int) -> None:
    rng = np.random.default_rng(9)
    still = run('+z', period=1.0).rows(slice(rows))
    n = len(still)
    shaken = np.where(np.arange(n) % 1000 < 300, 30.0, 1.0) if n > 1000 else np.ones(n)
    force = still.linear_acceleration + 1e-2 * shaken[:, None] * rng.normal(size=(n, 3))
    at = np.array([20]) if n < 1000 else np.array([500, 777, 1600, 2900])
    force[at, 1] += 2.0
    _, found = check_recording(replace(still, linear_acceleration=force), 'shaken')
    assert [(f.name, f.sensor, f.rows) for f in found] == [('spikes', 'accelerometer', len(at))]


def test_a_pulse_of_the_heater_is_no_spike_of_the_magnetometer() -> None:
    rng = np.random.default_rng(8)
    still = run('+z')
    pulses = np.zeros(len(still))
    pulses[rng.choice(len(still) - 2, 40, replace=False) + 1] = 1.0
    struck = pulses[:, None] * [6e-6, 0.0, 0.0]
    recording = replace(still, magnetic_field=still.magnetic_field + struck)
    _, blind = check_recording(recording, 'blind')
    assert [f.name for f in blind] == ['spikes']
    _, found = check_recording(replace(recording, heater=pulses), 'logged')
    assert found == []
