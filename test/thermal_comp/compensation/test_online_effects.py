# SPDX-License-Identifier: Apache-2.0
"""Each device effect: stream and recording agree wherever the stream is cut."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.compensation.stream import Compensator, compensate
from thermal_comp.data.conditions import SENSORS
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect

from imu_recording import ImuRecording

from .test_stream import columns, model_of, stream

DEVICE = sorted(name for name, effect in EFFECTS.items() if effect.kind == 'device')
NEEDING = sorted(name for name in DEVICE if EFFECTS[name].channels)
ROWS = 120


@pytest.fixture(scope='module')
def recording() -> ImuRecording:
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
def test_stream_equals_recording_wherever_it_is_cut(
    name: str, recording: ImuRecording, tmp_path: Path
) -> None:
    size = scale_of(EFFECTS[name], recording)
    assert size > 0.0
    expected = columns(compensate(recording, model_of(name)))
    generator = np.random.default_rng(DEVICE.index(name))
    anywhere = generator.choice(np.arange(3, ROWS), 12, replace=False)
    for places in ((), tuple(sorted({1, 2, 40, 41, *anywhere.tolist()}))):
        found = stream(recording, model_of(name), cuts=places, path=tmp_path / 'state.json')
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * size)


@pytest.mark.parametrize('name', DEVICE)
def test_a_restart_without_the_state_says_that_the_history_is_lost(
    name: str, recording: ImuRecording
) -> None:
    cut = ROWS // 2
    whole = columns(compensate(recording, model_of(name)))[cut:]
    late = columns(compensate(recording.rows(slice(cut, None)), model_of(name)))
    forgets = bool(np.abs(whole - late).max() > 1e-9 * scale_of(EFFECTS[name], recording))
    said = Compensator(model_of(name)).report()[1]
    assert ('history lost' in said) == forgets


@pytest.mark.parametrize('name', NEEDING)
def test_without_its_channel_it_is_not_applied_named_and_paid_for(
    name: str, recording: ImuRecording
) -> None:
    effect = EFFECTS[name]
    blank = dict.fromkeys(effect.channels)
    without = replace(recording, **blank)
    sensors = [SENSORS.index(s) for s in effect.sensors]
    done = compensate(without, model_of(name))
    np.testing.assert_array_equal(columns(done), columns(without))
    assert any(name in note and effect.channels[0] in note for note in done.notes)
    known, unknown = Compensator(model_of(name)), Compensator(model_of(name))
    stamp = int(recording.stamp[-1])
    variances = []
    for compensator in (known, unknown):
        compensator.on_temperature(stamp, 20.0)
        if compensator is known:
            for channel in effect.channels:
                value = getattr(recording, channel)[-1]
                plain = tuple(value.tolist()) if np.ndim(value) else float(value)
                compensator.on_channel(channel, stamp, plain)
        rate, force = compensator.on_imu(stamp, (0.0,) * 3, (0.0, 0.0, 9.8))
        field = compensator.on_magnetic_field(stamp, (1e-5,) * 3)
        variances.append([np.trace(v.covariance) for v in (force, rate, field)])
    assert name not in known.condition.not_applied
    assert unknown.condition.not_applied == {name: ', '.join(effect.channels)}
    for place in sensors:
        assert variances[1][place] > 10.0 * variances[0][place]
