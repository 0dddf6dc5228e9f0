# SPDX-License-Identifier: Apache-2.0
"""Conditions of a start, and faults that take a run to the safe state."""

from __future__ import annotations

from collections.abc import Sequence

from chamber_profile.profile.values import Profile, Step
from chamber_profile.run.values import LINK_OK, Readings

MIN_FREE_BYTES = 1 << 30
"""Least free space where a run is recorded [bytes]."""
LIMIT_MARGIN_K = 1.0
"""Overshoot of the air beyond the profile's limits that is tolerated [K]."""


def check_problems(profile: Profile, steps: Sequence[Step], readings: Readings) -> list[str]:
    """Return everything that prevents a start; empty: nothing does."""
    if readings.link != LINK_OK or readings.air is None:
        return ['the chamber does not answer', *_external_faults(readings)]
    problems = [f'alarm {alarm}' for alarm in readings.alarms]
    problems += _external_faults(readings)
    limits = profile.limits
    if not limits.air_min_c <= readings.air <= limits.air_max_c:
        problems.append(
            f'the air is at {readings.air:.1f} °C, outside the limits '
            f'{limits.air_min_c:g} … {limits.air_max_c:g} °C'
        )
    low, high = limits.device_min_c, limits.device_max_c
    if readings.device is not None and not low <= readings.device <= high:
        problems.append(
            f'the device is at {readings.device:.1f} °C, outside the limits {low:g} … {high:g} °C'
        )
    watched = {step.stabilise.source for step in steps if step.stabilise}
    if watched - {'air'} and readings.device is None:
        problems.append('the profile needs the device temperature, and no sensor reports it')
    return problems


def _external_faults(readings: Readings) -> list[str]:
    problems = []
    if not readings.imu_alive:
        problems.append('no data from the IMU for 10 s (require_imu)')
    if readings.disk_free < MIN_FREE_BYTES:
        problems.append(f'{readings.disk_free / 2**30:.2f} GiB of disk left, 1 GiB needed')
    if readings.fault:
        problems.append(readings.fault)
    return problems


def trip_reason(profile: Profile, readings: Readings, *, waiting: bool) -> str:
    """Return why the run must go to the safe state; '' where it need not.

    While the run is `waiting` for an operator at the open chamber, the IMU may be unplugged.
    """
    if readings.alarms:
        return f'alarm {", ".join(readings.alarms)}'
    limits = profile.limits
    air, device = readings.air, readings.device
    low, high = limits.air_min_c - LIMIT_MARGIN_K, limits.air_max_c + LIMIT_MARGIN_K
    if air is not None and not low <= air <= high:
        return f'air at {air:.1f} °C, limits {limits.air_min_c:g} … {limits.air_max_c:g} °C'
    low, high = limits.device_min_c, limits.device_max_c
    if device is not None and not low <= device <= high:
        return f'device at {device:.1f} °C, limits {low:g} … {high:g} °C'
    faults = _external_faults(readings)
    if waiting and not readings.imu_alive:
        faults = faults[1:]
    return faults[0] if faults else ''
