# SPDX-License-Identifier: Apache-2.0
"""The chamber profile of a short calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

REFERENCE_C = 20.0
RATE_C_PER_MIN = 2.0
"""Of the ramps, as in Betta et al. 2022."""
LEAST_DWELL_S = 120.0
MARGIN_C = 5.0
"""Between the set-points and the limits of the air."""
POSES = ('+x', '+y', '+z')


def short_profile(curve: Mapping[str, Any]) -> dict[str, Any]:
    """Return the shortest campaign of a curve (`shortening.curve_content`) as a profile."""
    shortest = curve['shortest']
    targets = curve['targets'][str(shortest['temperatures'])]
    dwell = float(max(LEAST_DWELL_S, round(curve['dwell_s'], -1)))
    steps: list[dict[str, Any]] = [
        {
            'id': 'precondition',
            'kind': 'precondition',
            'target_c': REFERENCE_C,
            'rate_c_per_min': RATE_C_PER_MIN,
            'dwell_s': dwell,
        }
    ]
    cycle = []
    level = REFERENCE_C
    for number, target in enumerate([*targets, REFERENCE_C], 1):
        if target != level:
            steps.append(
                {
                    'id': f'ramp_{number}',
                    'kind': 'ramp',
                    'target_c': target,
                    'rate_c_per_min': RATE_C_PER_MIN,
                }
            )
            cycle.append(f'ramp_{number}')
        level = target
        if number <= len(targets):
            steps.append({'id': f'dwell_{number}', 'kind': 'dwell', 'dwell_s': dwell})
            cycle.append(f'dwell_{number}')
    steps.append(
        {
            'id': 'final',
            'kind': 'final',
            'target_c': REFERENCE_C,
            'rate_c_per_min': RATE_C_PER_MIN,
            'dwell_s': LEAST_DWELL_S,
        }
    )
    poses = ', '.join(POSES[: shortest['poses']])
    return {
        'schema': 1,
        'name': 'short_fleet',
        'description': f'{shortest["temperatures"]} temperatures, up axis {poses}, '
        'for devices of a lot that is known',
        'limits': {
            'air_min_c': min(*targets, REFERENCE_C) - MARGIN_C,
            'air_max_c': max(*targets, REFERENCE_C) + MARGIN_C,
            'device_max_c': 85.0,
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
