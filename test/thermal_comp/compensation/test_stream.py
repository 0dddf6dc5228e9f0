# SPDX-License-Identifier: Apache-2.0
"""A stream is compensated like a recording, wherever it is cut and in spite of what is missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.compensation.recording import plan_of, sensor_error
from thermal_comp.compensation.state import restore_state, save_state
from thermal_comp.compensation.stream import Compensator, compensate
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import example_conditions
from thermal_comp.model.values import ModelError, SensorModel, ThermalModel

from imu_recording import ImuRecording, RecordingError, read_bag, write_bag

from ..campaign import run
from ..models import line_model

CHANNELS = ('supply_voltage', 'chamber_temperature', 'humidity', 'vibration')


def model_of(*names: str) -> ThermalModel:
    """A model with made-up coefficients of these effects in every sensor they act on."""
    rng = np.random.default_rng(3)
    line = line_model()
    sensors = {}
    for sensor, part in line.sensors.items():
        effects = tuple(EFFECTS[n]() for n in names if sensor in EFFECTS[n].sensors)
        conditions = example_conditions(sensor=sensor)
        shapes = [e.columns(conditions)[0].shape for e in effects]
        coefficients = tuple(
            1e-4 * rng.standard_normal((w[-1],) if len(w) == 3 else (w[-1], 3)) for w in shapes
        )
        size = sum(c.size for c in coefficients)
        sensors[sensor] = SensorModel(
            effects,
            coefficients,
            1e-12 * np.eye(size),
            part.noise,
            contributions={e.name: np.full(3, 1e-3) for e in effects},
            temperature_range=(-5.0, 45.0),
        )
    return replace(line, device='board', sensors=sensors)


def stream(
    recording: ImuRecording, model: ThermalModel, *, cuts: tuple[int, ...] = (), path: Path
) -> np.ndarray:
    """Feed a recording sample by sample, handing the history over a file at each cut."""
    compensator = Compensator(model)
    out = []
    for i, stamp in enumerate(recording.stamp.tolist()):
        if i in cuts:
            save_state(compensator, path)
            compensator = Compensator(model)
            assert restore_state(compensator, path) == ''
        compensator.on_temperature(stamp, float(recording.temperature[i]))
        for name in CHANNELS:
            column = getattr(recording, name)
            if column is not None and np.isfinite(column[i]).all():
                value = tuple(column[i].tolist()) if column.ndim == 2 else float(column[i])
                compensator.on_channel(name, stamp, value)
        field = tuple(recording.magnetic_field[i].tolist())
        before = compensator.on_magnetic_field(stamp, field) if i % 2 else None
        rate, force = compensator.on_imu(
            stamp,
            tuple(recording.angular_velocity[i].tolist()),
            tuple(recording.linear_acceleration[i].tolist()),
        )
        after = before or compensator.on_magnetic_field(stamp, field)
        out.append([*rate.value, *force.value, *after.value])
    return np.array(out)


def columns(recording: ImuRecording) -> np.ndarray:
    parts = (recording.angular_velocity, recording.linear_acceleration, recording.magnetic_field)
    return np.concatenate(parts, axis=1)


def short(rows: int = 700) -> ImuRecording:
    recording = run(cycles=1).rows(slice(300, 300 + rows))
    rng = np.random.default_rng(9)
    n = len(recording)
    supply = 3.3 + 0.01 * rng.standard_normal(n)
    supply[:20] = np.nan
    return replace(
        recording,
        supply_voltage=supply,
        chamber_temperature=recording.temperature + 1.0,
        humidity=0.5 + 0.1 * np.sin(np.arange(n) / 50.0),
        vibration=rng.random((n, 3)) * 0.01,
    )


def test_errors_kept_by_temperature_are_few_and_those_of_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Counts come back after others have pushed them out."""
    monkeypatch.setattr('thermal_comp.compensation.stream.REMEMBERED_TEMPERATURES', 3)
    model = model_of('bias_temperature', 'bias_temperature_curvature')
    counts = np.random.default_rng(15).integers(-8, 8, 200)
    recording = replace(short(200), temperature=20.0 + counts / 16.0)
    found = stream(recording, model, path=tmp_path / 'state.json')
    np.testing.assert_allclose(found, columns(compensate(recording, model)), rtol=0, atol=1e-12)
    compensator = Compensator(model)
    for stamp, temperature in zip(recording.stamp.tolist(), recording.temperature, strict=True):
        compensator.on_temperature(stamp, float(temperature))
        compensator.on_imu(stamp, (0.0, 0.0, 0.0), (0.0, 0.0, 9.8))
    assert all(len(kept) <= 3 for kept in compensator._errors.values())


@pytest.mark.parametrize('cuts', [(), (1,), (250, 251, 600)])
def test_stream_equals_recording_without_history(cuts: tuple[int, ...], tmp_path: Path) -> None:
    model = model_of('bias_temperature', 'bias_temperature_curvature', 'scale_factor_temperature')
    recording = short()
    found = stream(recording, model, cuts=cuts, path=tmp_path / 'state.json')
    np.testing.assert_allclose(found, columns(compensate(recording, model)), rtol=0, atol=1e-12)


@pytest.mark.parametrize('cuts', [(), (100, 400, 401)])
def test_stream_equals_recording_with_every_device_effect(
    cuts: tuple[int, ...], tmp_path: Path
) -> None:
    names = [name for name, effect in EFFECTS.items() if effect.kind == 'device']
    recording = short()
    model = model_of(*names)
    found = stream(recording, model, cuts=cuts, path=tmp_path / 'state.json')
    expected = columns(compensate(recording, model))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert np.abs(expected - columns(recording)).max() > 1e-4


def test_vibration_is_taken_from_fast_samples_alike(tmp_path: Path) -> None:
    n = 1000
    rng = np.random.default_rng(4)
    recording = ImuRecording(
        stamp=np.arange(n) * 10_000_000 + 10**18,
        angular_velocity=1e-3 * rng.standard_normal((n, 3)),
        linear_acceleration=rng.standard_normal((n, 3)) + [0.0, 0.0, 9.8],
        magnetic_field=np.full((n, 3), 2e-5),
        temperature=np.full(n, 30.0),
        device='board',
    )
    model = model_of('bias_temperature', 'vibration_rectification')
    found = stream(recording, model, path=tmp_path / 'none')
    expected = columns(compensate(recording, model))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    still = columns(compensate(recording, model_of('bias_temperature')))
    assert np.abs((expected - still)[200:, 3:6]).min() > 0.0


def test_a_channel_that_is_absent_is_named_and_makes_it_uncertain() -> None:
    with_channel, without = (Compensator(model_of('supply_sensitivity')) for _ in range(2))
    with_channel.on_channel('supply_voltage', 0, 3.31)
    results = []
    for compensator in (with_channel, without):
        compensator.on_temperature(0, 25.0)
        results.append(compensator.on_imu(1, (0.0,) * 3, (0.0, 0.0, 9.8))[0])
    assert results[1].value == (0.0, 0.0, 0.0)
    assert results[1].covariance[0, 0] == pytest.approx(1e-6)
    assert results[0].covariance[0, 0] < 1e-9
    level, line, values = without.report()
    assert level == 1
    assert 'not applied: supply_sensitivity' in line
    assert values['not_applied'] == 'supply_sensitivity needs supply_voltage'
    assert with_channel.report()[0] == 0


def test_history_is_restored_or_said_to_be_lost(tmp_path: Path) -> None:
    path = tmp_path / 'state.json'
    model = model_of('bias_temperature', 'thermal_lag')
    first = Compensator(model)
    assert 'history lost' in first.report()[1]
    assert 'does not exist yet' in restore_state(first, path)
    first.on_temperature(0, 20.0)
    first.on_imu(1, (0.0,) * 3, (0.0, 0.0, 9.8))
    save_state(first, path)
    second = Compensator(model)
    assert restore_state(second, path) == ''
    assert second.condition.history == 'restored'
    other = Compensator(model_of('bias_temperature'))
    assert 'another model' in restore_state(other, path)
    path.write_text('{"schema"')
    assert 'cannot be read' in restore_state(Compensator(model), path)
    assert Compensator(model_of('bias_temperature')).condition.history == 'not needed'
    assert [p.name for p in tmp_path.iterdir()] == ['state.json']


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


def test_a_late_sample_does_not_disturb_the_history() -> None:
    model = model_of('thermal_lag')
    straight, disturbed = Compensator(model), Compensator(model)
    last = []
    for compensator in (straight, disturbed):
        for second in range(5):
            compensator.on_temperature(second * 10**9, 20.0 + second)
            found = compensator.on_imu(second * 10**9, (0.0,) * 3, (0.0, 0.0, 9.8))
            if compensator is disturbed and second == 3:
                compensator.on_imu(int(2.5e9), (0.0,) * 3, (0.0, 0.0, 9.8))
        last.append(found[0].value)
    assert last[0] == last[1]


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
