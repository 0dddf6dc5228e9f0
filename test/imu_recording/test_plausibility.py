# SPDX-License-Identifier: Apache-2.0
"""Numbers that no sensor on Earth gives in SI units are refused, with the unit they look like."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_recording.plausibility import admitted
from imu_recording.recording import RecordingError

from imu_recording import ImuRecording, read_bag


@pytest.fixture(scope='module')
def run(bags: Path) -> ImuRecording:
    return read_bag(bags / 'dut1_x')


def test_every_bundled_bag_is_admitted(bags: Path) -> None:
    for bag in sorted(bags.glob('dut[23]_x')) + [bags / 'dut1_motion', bags / 'hidden_effect_y']:
        recording = read_bag(bag)
        assert admitted(recording) is recording


@pytest.mark.parametrize(
    ('field', 'factor', 'offset', 'unit'),
    [
        ('linear_acceleration', 1 / 9.80665, 0.0, 'g'),
        ('linear_acceleration', 1e3 / 9.80665, 0.0, 'mg'),
        ('magnetic_field', 1e4, 0.0, 'gauss'),
        ('magnetic_field', 1e6, 0.0, 'µT'),
        ('magnetic_field', 1e-6, 0.0, 'counts'),
        ('angular_velocity', 180 / np.pi, 0.0, '°/s'),
        ('temperature', 1.8, 32.0, '°F'),
        ('temperature', 1.0, 273.15, '-90 … 200'),
        ('linear_acceleration', 1671.0, 0.0, '-400 … 400'),
        ('chamber_temperature', 1.8, 32.0, '°F'),
        ('pressure', 1e-2, 0.0, 'hPa'),
        ('humidity', 100.0, 0.0, '%'),
        ('supply_voltage', 1000.0, 0.0, 'mV'),
    ],
)
def test_another_unit_is_refused_by_name(
    run: ImuRecording, field: str, factor: float, offset: float, unit: str
) -> None:
    every = np.ones(len(run))
    right = replace(run, pressure=98e3 * every, humidity=0.4 * every, supply_voltage=3.3 * every)
    assert admitted(right) is right
    wrong = replace(right, **{field: getattr(right, field) * factor + offset})
    with pytest.raises(RecordingError, match=field) as refused:
        admitted(wrong)
    assert unit in str(refused.value)
    assert '--accept units' in str(refused.value)
    assert admitted(wrong, ['units']) is wrong


def test_a_few_damaged_values_are_left_out_and_counted(run: ImuRecording) -> None:
    values = run.linear_acceleration.copy()
    values[[7, 900]] = [[3.4e127, 0.0, 9.8], [1e5, 1e5, 1e5]]
    found = admitted(replace(run, linear_acceleration=values))
    assert np.isnan(found.linear_acceleration).sum() == 4
    assert found.notes[-1] == (
        'linear_acceleration: 2 rows with impossible values (up to 3.4e+127) left out'
    )


def test_error_codes_of_a_thermometer_are_left_out_and_counted(run: ImuRecording) -> None:
    values = run.temperature.copy()
    values[::50] = -127.0
    found = admitted(replace(run, temperature=values))
    assert np.array_equal(np.isnan(found.temperature), values == -127.0)
    assert found.notes[-1].endswith('rows with impossible values (up to -127) left out')


@pytest.mark.parametrize('axes', [[0, 1, 2], [1]])
def test_counts_too_coarse_for_a_gyroscope_are_degrees(run: ImuRecording, axes: list[int]) -> None:
    count = np.radians(0.00875)
    noise = np.random.default_rng(0).normal(0.0, 0.1, run.angular_velocity.shape)
    rates = np.round(0.3 * (run.temperature[:, None] - 20.0) + noise) * count
    raw = replace(run, angular_velocity=rates)
    assert admitted(raw) is raw
    rates = rates.copy()
    rates[:, axes] = np.degrees(rates[:, axes])  # too quiet for the noise to tell
    with pytest.raises(RecordingError, match=r'counts of .* as if in °/s'):
        admitted(replace(run, angular_velocity=rates))


def test_a_line_of_the_mains_is_no_noise_in_degrees(run: ImuRecording) -> None:
    """Sixty times the noise, it made steps as large as noise in °/s would."""
    line = 0.02 * np.sin(2.0 * np.pi * (0.079 + 1e-5 * run.temperature) * run.time)
    noisy = replace(run, angular_velocity=run.angular_velocity + line[:, None])
    assert admitted(noisy) is noisy
    with pytest.raises(RecordingError, match=r'as if in °/s'):
        admitted(replace(noisy, angular_velocity=np.degrees(noisy.angular_velocity)))


def alone(run: ImuRecording, temperature: np.ndarray) -> ImuRecording:
    return replace(
        run,
        temperature=temperature,
        chamber_temperature=None,
        chamber_temperature_2=None,
        device_temperature=None,
        setpoint=None,
    )


def test_a_second_thermometer_in_the_air_tells_fahrenheit_from_celsius(run: ImuRecording) -> None:
    second = replace(alone(run, run.temperature), chamber_temperature_2=run.chamber_temperature)
    assert admitted(second) is second
    assert run.chamber_temperature is not None
    wrong = replace(second, chamber_temperature_2=run.chamber_temperature * 1.8 + 32.0)
    with pytest.raises(RecordingError, match=r'chamber_temperature_2 is .* as if in °F'):
        admitted(wrong)


@pytest.mark.parametrize('step', [0.0625, 1 / 256, 0.1, 0.01])
def test_a_thermometers_steps_tell_fahrenheit_without_a_chamber(
    run: ImuRecording, step: float
) -> None:
    smooth = run.temperature + np.random.default_rng(0).normal(0.0, 0.01, len(run))
    celsius = np.round((15.0 + 0.2 * smooth) / step) * step
    right = alone(run, celsius)
    assert admitted(right) is right
    with pytest.raises(RecordingError, match=r'temperature has steps of .* °C, as if in °F'):
        admitted(alone(run, celsius * 1.8 + 32.0))


def test_a_die_hotter_than_sensors_are_made_for_is_in_fahrenheit(run: ImuRecording) -> None:
    smooth = run.temperature + np.random.default_rng(0).normal(0.0, 0.01, len(run))
    with pytest.raises(RecordingError, match=r'for 105 at most: as if in °F'):
        admitted(alone(run, smooth * 1.8 + 32.0))
    automotive = alone(run, smooth * 2.5 - 10.0)  # −35 … 115 °C
    assert admitted(automotive) is automotive


def test_a_die_that_is_hot_throughout_is_noted(run: ImuRecording) -> None:
    smooth = 24.0 + 0.1 * run.temperature + np.random.default_rng(0).normal(0.0, 0.01, len(run))
    note = admitted(alone(run, smooth * 1.8 + 32.0)).notes[-1]
    assert note.startswith('temperature is 73.')
    assert note.endswith('where it is in °F, say so in the mapping')
    assert admitted(alone(run, smooth)).notes == run.notes


def test_a_device_that_turns_about_the_vertical_is_no_wrong_unit(run: ImuRecording) -> None:
    rate = np.tile([1.0, 0.0, 0.0], (len(run), 1))
    angle = run.time
    field = 3e-5 * np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    turning = replace(run, angular_velocity=rate, magnetic_field=field)
    assert admitted(turning) is turning
    unseen = replace(turning, magnetic_field=np.full_like(field, np.nan))
    assert admitted(unseen) is unseen


def test_compensated_data_are_taken_only_when_told(run: ImuRecording) -> None:
    done = replace(run, compensated='model of dut1, sha256 00')
    with pytest.raises(RecordingError, match='compensated already'):
        admitted(done)
    assert admitted(done, ['compensated']) is done
