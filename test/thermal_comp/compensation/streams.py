# SPDX-License-Identifier: Apache-2.0
"""Recordings and models for compensation, and a recording fed sample by sample."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from thermal_comp.compensation.state import restore_state, save_state
from thermal_comp.compensation.stream import Compensator
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import example_conditions
from thermal_comp.model.values import SensorModel, ThermalModel

from imu_recording import ImuRecording

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
