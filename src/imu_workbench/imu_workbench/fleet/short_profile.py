# SPDX-License-Identifier: Apache-2.0
"""The chamber profile of a short calibration, and how long it takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from chamber_profile.profile.file import profile_from_content
from chamber_profile.profile.timetable import timetable

REFERENCE_C = 20.0
RATE_C_PER_MIN = 2.0
"""Rate of the ramps, as in Betta et al. 2022 [°C/min]."""
LEAST_DWELL_S = 120.0
AIR_LIMIT_MARGIN_C = 5.0
"""Distance of the set-points from the limits of the air [K]."""
DEVICE_MAX_C = 85.0
POSES = ('+x', '+y', '+z')


def least_dwell(seconds: float) -> float:
    """Return a dwell [s] in whole tens, no shorter than a device needs to settle."""
    return max(LEAST_DWELL_S, round(float(seconds), -1))


def run_hours(targets: Sequence[float], dwells: Sequence[float]) -> float:
    """Return how long one run with these temperatures [°C] and dwells [s] takes [h]."""
    entries = timetable(profile_from_content(_profile(targets, dwells, '')))
    return entries[-1].end_s / 3600.0


def short_profile(shortest: Mapping[str, Any]) -> dict[str, Any]:
    """Return the shortest campaign of a curve (`shortening.shortest`) as a profile."""
    poses = ', '.join(POSES[: shortest['poses']])
    description = (
        f'{shortest["temperatures"]} temperatures, up axis {poses}, for devices of a lot that is '
        'known'
    )
    return _profile(shortest['targets'], shortest['dwells_s'], description)


def _profile(
    targets: Sequence[float], dwells: Sequence[float], description: str
) -> dict[str, Any]:
    precondition = _moving('precondition', 'precondition', REFERENCE_C)
    steps: list[dict[str, Any]] = [precondition | {'dwell_s': LEAST_DWELL_S}]
    cycle = []
    level = REFERENCE_C
    for number, target in enumerate([*targets, REFERENCE_C], 1):
        if target != level:
            steps.append(_moving(f'ramp_{number}', 'ramp', target))
            cycle.append(f'ramp_{number}')
        level = target
        if number <= len(targets):
            dwell = {'id': f'dwell_{number}', 'kind': 'dwell', 'dwell_s': dwells[number - 1]}
            steps.append(dwell)
            cycle.append(f'dwell_{number}')
    steps.append(_moving('final', 'final', REFERENCE_C) | {'dwell_s': LEAST_DWELL_S})
    return {
        'schema': 1,
        'name': 'short_fleet',
        'description': description,
        'limits': {
            'air_min_c': min(*targets, REFERENCE_C) - AIR_LIMIT_MARGIN_C,
            'air_max_c': max(*targets, REFERENCE_C) + AIR_LIMIT_MARGIN_C,
            'device_max_c': max(
                DEVICE_MAX_C, *(target + AIR_LIMIT_MARGIN_C for target in targets)
            ),
            'rate_max_c_per_min': RATE_C_PER_MIN,
        },
        'stabilise': {
            'source': 'air',
            'band_c': 0.5,
            'hold_s': 0,
            'timeout_s': 1800,
            'on_timeout': 'abort',
        },
        'dwell_mode': 'free',
        'steps': steps,
        'cycles': {'from': cycle[0], 'to': cycle[-1], 'count': 1},
        'on_abort': {
            'target_c': REFERENCE_C,
            'rate_c_per_min': RATE_C_PER_MIN,
            'timeout_s': 1800,
        },
    }


def _moving(name: str, kind: str, target: float) -> dict[str, Any]:
    return {'id': name, 'kind': kind, 'target_c': target, 'rate_c_per_min': RATE_C_PER_MIN}
