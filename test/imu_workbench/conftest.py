# SPDX-License-Identifier: Apache-2.0
"""Small recordings with known answers."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from imu_recording.recording import PHASES, ImuRecording

LEGS = (  # phase, seconds, set-point at its end [°C]; the paper's plan ten times faster
    ('ramp_down', 90, -10.0),
    ('dwell_cold', 180, -10.0),
    ('ramp_up', 180, 50.0),
    ('dwell_hot', 180, 50.0),
    ('ramp_down', 90, 20.0),
    ('dwell_reference', 180, 20.0),
)
SLOPES = {  # per kelvin, of dut1's axes; dut2's have the opposite sign
    'angular_velocity': (4e-5, -2e-5, 1e-5),
    'linear_acceleration': (2e-3, -1e-3, 3e-3),
    'magnetic_field': (2e-7, -1e-7, 3e-7),
}
NOISE = {'angular_velocity': 1e-4, 'linear_acceleration': 3e-3, 'magnetic_field': 1e-7}
UP = {'x': 0, 'y': 1, 'z': 2}


def thermal_plan(rate_hz: float, cycles: int):
    """Return time, set-point, phase and cycle of a short plan."""
    period = 1.0 / rate_hz
    legs = [('precondition', 300, 20.0, 0)]
    legs += [(*leg, number) for number in range(1, cycles + 1) for leg in LEGS]
    legs.append(('final', 180, 20.0, 0))
    setpoint, phase, cycle, level = [], [], [], 20.0
    for name, seconds, target, number in legs:
        n = round(seconds / period)
        setpoint.append(np.linspace(level, target, n, endpoint=False))
        phase.append(np.full(n, PHASES.index(name)))
        cycle.append(np.full(n, number))
        level = target
    columns = [np.concatenate(parts) for parts in (setpoint, phase, cycle)]
    return np.arange(len(columns[0])) * period, *columns


def synthetic_run(
    device: str = 'dut1',
    up: str = 'z',
    *,
    rate_hz: float = 1.0,
    cycles: int = 4,
    seed: int = 1,
    sign: float | None = None,
) -> ImuRecording:
    """Return a still device whose error is a line in temperature plus white noise."""
    rng = np.random.default_rng(seed)
    time, setpoint, phase, cycle = thermal_plan(rate_hz, cycles)
    air = setpoint + 0.1 * np.sin(time / 30.0)
    temperature = np.empty_like(air)
    level = air[0]
    share = 1.0 - np.exp(-1.0 / (20.0 * rate_hz))
    for i, value in enumerate(air):
        level += share * (value - level)
        temperature[i] = level
    temperature += 2.5
    truth = {
        'angular_velocity': np.zeros(3),
        'linear_acceleration': 9.81 * np.eye(3)[UP[up]],
        'magnetic_field': np.roll([20e-6, 5e-6, -40e-6], UP[up]),
    }
    sign = (-1.0 if device == 'dut2' else 1.0) if sign is None else sign
    measured = {
        name: value
        + sign * np.outer(temperature - 20.0, SLOPES[name])
        + rng.normal(0.0, NOISE[name], (len(time), 3))
        for name, value in truth.items()
    }
    return ImuRecording(
        stamp=1_700_000_000_000_000_000 + np.round(time * 1e9).astype(np.int64),
        temperature=temperature,
        chamber_temperature=air,
        device_temperature=temperature - 0.5,
        setpoint=setpoint,
        phase=phase.astype(np.int64),
        cycle=cycle.astype(np.int64),
        device=device,
        run=f'{device}_{up}',
        up_axis=f'+{up}',
        profile='short_plan',
        source=f'{device}_{up}',
        **measured,
    )


@pytest.fixture(scope='session')
def run() -> Callable[..., ImuRecording]:
    """Return the function that makes a synthetic run."""
    return synthetic_run


@pytest.fixture(scope='session')
def writers() -> ModuleType:
    """Return what writes recordings as the logs of autopilots."""
    path = Path(__file__).parents[1] / 'imu_recording' / 'log_writers.py'
    spec = importlib.util.spec_from_file_location('log_writers', path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='session')
def fleet_bags(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder with the bags of three simulated devices of two lots."""
    from imu_workbench.simulate.campaign import Logging
    from imu_workbench.simulate.fleet import FleetPlan, write_fleet

    folder = tmp_path_factory.mktemp('fleet') / 'bags'
    plan = FleetPlan('short_20min', devices=3, lots=2, seed=3, logging=Logging(0.5, mean=True))
    write_fleet(plan, folder, 1)
    return folder
