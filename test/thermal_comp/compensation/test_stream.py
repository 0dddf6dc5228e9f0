# SPDX-License-Identifier: Apache-2.0
"""A stream is compensated like a recording, wherever it is cut and in spite of what is missing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.compensation.recording import compensate
from thermal_comp.compensation.state import restore_state, save_state
from thermal_comp.compensation.stream import Compensator
from thermal_comp.data.conditions import SENSORS
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect

from imu_recording import ImuRecording

from .streams import columns, model_of, short, stream

DEVICE = sorted(name for name, effect in EFFECTS.items() if effect.kind == 'device')
NEEDING = sorted(name for name in DEVICE if EFFECTS[name].channels)
ROWS = 120
"""Rows of the recording that swings through the temperatures."""


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


@pytest.mark.parametrize('cuts', [pytest.param((), marks=pytest.mark.long), (100, 400, 401)])
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


@pytest.fixture(scope='module')
def swinging() -> ImuRecording:
    """Ten seconds a row through −12 … 44 °C with gaps, every channel known."""
    rng = np.random.default_rng(8)
    step = rng.uniform(4.0, 16.0, ROWS)
    step[[40, 90]] = 300.0
    time = np.cumsum(step)
    swing = np.sin(time / 260.0)
    track = 16.0 + 28.0 * swing
    return ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64) + 1_700_000_000_000_000_000,
        angular_velocity=rng.normal(0.0, 0.1, (ROWS, 3)),
        linear_acceleration=rng.normal(0.0, 1.0, (ROWS, 3)) + [0.0, 0.0, 9.8],
        magnetic_field=rng.normal(0.0, 1e-6, (ROWS, 3)) + [1.8e-5, 0.0, -4e-5],
        temperature=track,
        chamber_temperature=track + 3.0 * np.cos(time / 260.0),
        device_temperature=track - 1.0,
        humidity=0.5 + 0.2 * swing,
        supply_voltage=3.3 + 0.01 * rng.standard_normal(ROWS),
        vibration=rng.random((ROWS, 3)) * 0.01,
        device='board',
    )


def scale_of(effect: type[Effect], recording: ImuRecording) -> float:
    """Return the largest error the effect makes in the recording."""
    made = columns(compensate(recording, model_of(effect.name))) - columns(recording)
    return float(np.abs(made).max())


@pytest.mark.parametrize('name', DEVICE)
def test_with_each_effect_stream_equals_recording_wherever_it_is_cut(
    name: str, swinging: ImuRecording, tmp_path: Path
) -> None:
    size = scale_of(EFFECTS[name], swinging)
    assert size > 0.0
    expected = columns(compensate(swinging, model_of(name)))
    generator = np.random.default_rng(DEVICE.index(name))
    anywhere = generator.choice(np.arange(3, ROWS), 12, replace=False)
    for places in ((), tuple(sorted({1, 2, 40, 41, *anywhere.tolist()}))):
        found = stream(swinging, model_of(name), cuts=places, path=tmp_path / 'state.json')
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize(
    'name',
    [
        pytest.param(name, marks=pytest.mark.long) if name == 'empirical_term' else name
        for name in DEVICE
    ],
)
def test_a_restart_without_the_state_says_that_the_history_is_lost(
    name: str, swinging: ImuRecording
) -> None:
    cut = ROWS // 2
    whole = columns(compensate(swinging, model_of(name)))[cut:]
    late = columns(compensate(swinging.rows(slice(cut, None)), model_of(name)))
    forgets = bool(np.abs(whole - late).max() > 1e-9 * scale_of(EFFECTS[name], swinging))
    said = Compensator(model_of(name)).report()[1]
    assert ('history lost' in said) == forgets


@pytest.mark.parametrize('name', NEEDING)
def test_without_its_channel_it_is_not_applied_named_and_paid_for(
    name: str, swinging: ImuRecording
) -> None:
    effect = EFFECTS[name]
    blank = dict.fromkeys(effect.channels)
    without = replace(swinging, **blank)
    sensors = [SENSORS.index(s) for s in effect.sensors]
    done = compensate(without, model_of(name))
    np.testing.assert_array_equal(columns(done), columns(without))
    assert any(name in note and effect.channels[0] in note for note in done.notes)
    known, unknown = Compensator(model_of(name)), Compensator(model_of(name))
    stamp = int(swinging.stamp[-1])
    variances = []
    for compensator in (known, unknown):
        compensator.on_temperature(stamp, 20.0)
        if compensator is known:
            for channel in effect.channels:
                value = getattr(swinging, channel)[-1]
                plain = tuple(value.tolist()) if np.ndim(value) else float(value)
                compensator.on_channel(channel, stamp, plain)
        rate, force = compensator.on_imu(stamp, (0.0,) * 3, (0.0, 0.0, 9.8))
        field = compensator.on_magnetic_field(stamp, (1e-5,) * 3)
        variances.append([np.trace(v.covariance) for v in (force, rate, field)])
    assert name not in known.condition.not_applied
    assert unknown.condition.not_applied == {name: ', '.join(effect.channels)}
    for place in sensors:
        assert variances[1][place] > 10.0 * variances[0][place]
