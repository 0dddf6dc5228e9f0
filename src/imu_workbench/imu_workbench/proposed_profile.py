# SPDX-License-Identifier: Apache-2.0
"""The chamber profile of a proposed experiment."""

from __future__ import annotations

from typing import Any

from thermal_comp.experiment.design import ChamberLimits, Proposal
from thermal_comp.experiment.plan import FINAL_S, PRECONDITION_S, REFERENCE_C


def profile_content(
    proposal: Proposal, names: tuple[str, str], limits: ChamberLimits
) -> dict[str, Any]:
    """Return the proposal in the profile format of chamber_profile."""
    steps: list[dict[str, Any]] = [
        {
            'id': 'precondition',
            'kind': 'precondition',
            'target_c': REFERENCE_C,
            'rate_c_per_min': limits.max_rate,
            'dwell_s': PRECONDITION_S,
        }
    ]
    ids = []
    for number, segment in enumerate(proposal.plan.cycle, 1):
        ramp = {
            'id': f'ramp_{number}',
            'kind': 'ramp',
            'target_c': segment.target,
            'rate_c_per_min': segment.rate,
        }
        steps += [ramp, {'id': f'dwell_{number}', 'kind': 'dwell', 'dwell_s': segment.dwell}]
        ids += [f'ramp_{number}', f'dwell_{number}']
    steps.append(
        {
            'id': 'final',
            'kind': 'final',
            'target_c': REFERENCE_C,
            'rate_c_per_min': limits.max_rate,
            'dwell_s': FINAL_S,
        }
    )
    return {
        'schema': 1,
        'name': f'{names[0]}_or_{names[1]}',
        'description': f'Tells {names[0]} from {names[1]}, three or more equal cycles',
        'limits': {
            'air_min_c': limits.low - 5.0,
            'air_max_c': limits.high + 5.0,
            'device_min_c': -40.0,
            'device_max_c': 85.0,
            'rate_max_c_per_min': limits.max_rate,
        },
        'stabilise': {
            'source': 'air',
            'band_c': 0.5,
            'hold_s': 0,
            'timeout_s': 7200,
            'on_timeout': 'abort',
        },
        'dwell_mode': 'free',
        'steps': steps,
        'cycles': {'from': ids[0], 'to': ids[-1], 'count': proposal.plan.repeats},
        'on_abort': {
            'target_c': REFERENCE_C,
            'rate_c_per_min': limits.max_rate,
            'timeout_s': 3600,
        },
    }
