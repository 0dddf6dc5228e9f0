# SPDX-License-Identifier: Apache-2.0
"""A device turned by known rotations while the chamber warms: ten minutes with true attitude."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
from chamber_profile.profile.file import profile_from_content
from imu_driver.simulation.devices import DeviceParameters
from imu_driver.simulation.environment import Environment
from imu_driver.simulation.pose import Motion, turns_with_rests
from imu_driver.simulation.read_out import ReadOut, read_out
from imu_driver.simulation.run import prepare_run

from imu_recording import ImuRecording
from imu_workbench.simulate.campaign import chamber_environment, hold_tracks

DURATION_S = 600.0
"""[s]"""
REST_BEFORE_RAMP_S = 60.0
"""Rest before the ramp starts [s]."""
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
ROTATIONS = (
    (X, 90.0),
    (X, -90.0),
    (Y, 90.0),
    (Y, -90.0),
    (Z, 90.0),
    (Z, -90.0),
    (X, 45.0),
    (Y, 30.0),
    (Z, 120.0),
    (Z, -120.0),
    (Y, -30.0),
    (X, -45.0),
    (Z, 360.0),
    (X, 180.0),
    (Z, 90.0),
    (Z, -90.0),
    (X, -180.0),
    (Y, 360.0),
    ((0.6, 0.8, 0.0), 75.0),
    ((0.6, 0.8, 0.0), -75.0),
    (Z, -180.0),
    (Z, 180.0),
)
"""Axis in the sensor frame and angle [°]; together they end where they start."""
RAMP_PROFILE = {
    'schema': 1,
    'name': 'motion_ramp',
    'description': 'One ramp from 20 °C to 36 °C',
    'limits': {'air_min_c': 10, 'air_max_c': 45, 'rate_max_c_per_min': 2},
    'stabilise': {
        'source': 'air',
        'band_c': 0.5,
        'hold_s': 0,
        'timeout_s': 3600,
        'on_timeout': 'abort',
    },
    'dwell_mode': 'free',
    'steps': [
        {
            'id': 'precondition',
            'kind': 'precondition',
            'target_c': 20,
            'rate_c_per_min': 2,
            'dwell_s': 900,
        },
        {'id': 'heat', 'kind': 'ramp', 'target_c': 36, 'rate_c_per_min': 2},
        {'id': 'hot', 'kind': 'dwell', 'dwell_s': 300},
        {'id': 'final', 'kind': 'final', 'target_c': 36, 'rate_c_per_min': 2, 'dwell_s': 60},
    ],
    'on_abort': {'target_c': 20, 'rate_c_per_min': 2, 'timeout_s': 1800},
}


def known_rotations() -> Motion:
    """Return ROTATIONS as turns of 4 s each, with rests between them."""
    rest = (DURATION_S - 40.0) / len(ROTATIONS) - 4.0
    return turns_with_rests(
        [(axis, float(np.deg2rad(angle))) for axis, angle in ROTATIONS],
        start=30.0,
        duration=4.0,
        rest=rest,
    )


def simulate_motion(
    device: str | DeviceParameters, *, rate_hz: float, seed: int, chamber_period: float = 10.0
) -> ImuRecording:
    """Return ten minutes of known rotations during a ramp of 2 °C/min, true attitude included."""
    profile = profile_from_content(RAMP_PROFILE)
    chamber = chamber_environment(profile, seed)
    moving = np.flatnonzero(np.diff(chamber.column('setpoint')) > 0.0)
    rising = moving[chamber.column('setpoint')[moving] >= 19.95]
    start = int(rising[0] - REST_BEFORE_RAMP_S / chamber.period)
    environment = window(chamber, start, int(DURATION_S / chamber.period) + 1)
    run = prepare_run(device, environment, seed=seed, motion=known_rotations())
    recording = read_out(run, ReadOut(rate_hz))
    return hold_tracks(replace(recording, run=f'{run.device.name}_motion'), chamber_period)


def window(environment: Environment, first: int, rows: int) -> Environment:
    """Return `rows` rows of an environment from row `first`, time from zero."""
    columns: dict[str, Any] = {
        item.name: value[first : first + rows]
        for item in fields(environment)
        if isinstance(value := getattr(environment, item.name), np.ndarray)
        and len(value) == len(environment.time)
    }
    columns['time'] = columns['time'] - columns['time'][0]
    return replace(environment, **columns)
