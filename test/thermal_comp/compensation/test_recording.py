# SPDX-License-Identifier: Apache-2.0
"""A whole recording: which rows are compensated, and how outside the fitted temperatures."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.compensation.recording import compensate, plan_of, sensor_error
from thermal_comp.compensation.stream import Compensator
from thermal_comp.effects.contract import example_conditions
from thermal_comp.model.values import ModelError

from imu_recording import RecordingError, read_bag, write_bag

from ..campaign import run
from ..models import line_model
from .streams import model_of, short


def test_rows_without_temperature_pass_and_extrapolated_rows_are_counted() -> None:
    recording = short(200)
    temperature = recording.temperature.copy()
    temperature[:10] = np.nan
    temperature[50:60] = 80.0
    model = replace(line_model(), device='board')
    raw = replace(recording, temperature=temperature)
    done = compensate(raw, model)
    np.testing.assert_array_equal(done.angular_velocity[:10], raw.angular_velocity[:10])
    assert any('10 rows without a die temperature are passed on' in n for n in done.notes)
    assert any('10 rows outside the fitted temperatures are extrapolated' in n for n in done.notes)
    held = compensate(raw, model, extrapolation='clamp')
    assert any(
        '10 rows outside the fitted temperatures are compensated as at' in n for n in held.notes
    )
    # The range ends at 50 °C, 30 K from the reference; the rows are 60 K from it.
    np.testing.assert_allclose(
        held.angular_velocity[55] - raw.angular_velocity[55],
        0.5 * (done.angular_velocity[55] - raw.angular_velocity[55]),
    )


@pytest.mark.parametrize('name', ['bias_temperature', 'bias_temperature_curvature'])
def test_outside_the_fitted_range_the_error_runs_on_with_its_slope_at_the_edge(
    name: str,
) -> None:
    """A ramp from -40 to 80 °C under a model of -5 … 45 °C: inside as fitted, outside straight."""
    model = model_of('bias_temperature', name) if 'curv' in name else model_of(name)
    conditions = replace(
        example_conditions(sensor='gyroscope'), temperature=np.linspace(-40.0, 80.0, 600)
    )
    found = sensor_error(plan_of(model.sensors['gyroscope']), conditions)
    modelled, _ = model.sensors['gyroscope'].modelled_error(conditions)
    inside = ~found.outside
    np.testing.assert_allclose(found.error[inside], modelled[inside])
    assert (inside == (np.abs(conditions.temperature - 20.0) <= 25.0)).all()
    slope = np.diff(found.error, axis=0)
    for side, edge in ((slice(0, 170), slice(175, 177)), (slice(430, 599), slice(423, 425))):
        near = slope[edge].mean(axis=0)
        np.testing.assert_allclose(slope[side], np.tile(near, (len(slope[side]), 1)), rtol=0.2)
        assert (np.ptp(slope[side], axis=0) < 1e-3 * np.abs(near).max()).all()
    variance = found.covariance[:, 0, 0]
    assert (np.diff(variance[430:]) > 0.0).all()
    assert (np.diff(variance[:170]) < 0.0).all()


@pytest.mark.parametrize('name', ['bias_temperature', 'bias_temperature_curvature', 'thermal_lag'])
def test_clamped_the_error_outside_is_that_of_the_edge(name: str) -> None:
    sensor = model_of(name).sensors['gyroscope']
    plan = plan_of(sensor, 'clamp')
    conditions = example_conditions(sensor='gyroscope')
    warm = np.minimum(np.linspace(20.0, 140.0, len(conditions)), 80.0)
    found = sensor_error(plan, replace(conditions, temperature=warm))
    held = sensor_error(plan, replace(conditions, temperature=np.minimum(warm, plan.high)))
    np.testing.assert_array_equal(found.error, held.error)
    assert found.outside.any()
    assert not held.outside.any()
    assert (found.covariance[-1].diagonal() > held.covariance[-1].diagonal()).all()


def test_another_device_is_refused() -> None:
    with pytest.raises(ModelError, match='the model is of dut1'):
        compensate(short(10), line_model())


def test_a_row_takes_the_newest_finite_temperature() -> None:
    recording = run(device='board')
    broken = recording.temperature.copy()
    broken[100:103] = np.nan
    held = recording.temperature.copy()
    held[100:103] = held[99]
    model = model_of('bias_temperature')
    found = compensate(replace(recording, temperature=broken), model)
    wanted = compensate(replace(recording, temperature=held), model)
    np.testing.assert_array_equal(found.angular_velocity, wanted.angular_velocity)


def test_a_silent_temperature_is_not_used_in_batch_either(tmp_path: Path) -> None:
    recording = run(device='board')
    recording = recording.rows(np.flatnonzero(np.abs(recording.temperature - 20.0) > 3.0)[:400])
    seconds = (recording.stamp[1] - recording.stamp[0]) * 1e-9
    measured = recording.stamp.copy()
    measured[150:230] = measured[149]
    temperature = recording.temperature.copy()
    temperature[150:230] = temperature[149]
    silent = replace(recording, temperature=temperature, temperature_stamp=measured)
    model = model_of('bias_temperature', 'thermal_lag')
    timeout = 20.5 * seconds
    found = compensate(silent, model, temperature_timeout=timeout)
    changed = (found.angular_velocity != silent.angular_velocity).any(axis=1)
    assert np.flatnonzero(~changed).tolist() == list(range(170, 230))
    assert any(note.startswith('60 rows whose die temperature is older') for note in found.notes)
    compensator = Compensator(model, temperature_timeout=timeout)
    for i, stamp in enumerate(silent.stamp.tolist()):
        if measured[i] == stamp:
            compensator.on_temperature(stamp, float(temperature[i]))
        rate, force = compensator.on_imu(
            stamp, tuple(silent.angular_velocity[i]), tuple(silent.linear_acceleration[i])
        )
        np.testing.assert_allclose(rate.value, found.angular_velocity[i], rtol=0, atol=1e-12)
        np.testing.assert_allclose(force.value, found.linear_acceleration[i], rtol=0, atol=1e-12)
    write_bag(found, tmp_path / 'bag')
    assert np.array_equal(read_bag(tmp_path / 'bag').temperature_stamp, measured)
    late = replace(silent, temperature_stamp=silent.stamp - 11 * 10**9)
    with pytest.raises(RecordingError, match='older than 10 s; allow more'):
        compensate(late, model)


def test_without_any_temperature_nothing_is_called_compensated() -> None:
    recording = run(device='board')
    blank = replace(recording, temperature=np.full(len(recording), np.nan))
    with pytest.raises(RecordingError, match='imu/temperature'):
        compensate(blank, model_of('bias_temperature'))
