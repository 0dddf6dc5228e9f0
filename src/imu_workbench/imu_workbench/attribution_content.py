# SPDX-License-Identifier: Apache-2.0
"""An attribution as plain values, and the paper's remarks about the filters with our numbers."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from imu_recording.recording import ImuRecording
from orientation_filters.errors import ErrorGroup

from imu_workbench.attribution import Attribution


def content_of(result: Attribution, recording: ImuRecording) -> dict[str, Any]:
    """Return the attribution as plain values, angles in degrees."""
    return {
        'bag': recording.source,
        'device': recording.device,
        'samples': len(result.recording),
        'against': result.against,
        'notes': list(result.recording.notes),
        'unplaced': dict(result.recording.unplaced),
        'costs': [asdict(cost) for cost in result.costs],
        'cutoff_sweep': [asdict(cost) for cost in result.sweep],
        'effort': [asdict(effort) for effort in result.efforts],
        'remarks': remarks(result),
        'groups': {
            name: [_group(group) for group in groups] for name, groups in result.groups.items()
        },
    }


def _group(group: ErrorGroup) -> dict[str, Any]:
    rms = {kind: float(np.degrees(value)) for kind, value in group.rms.items()}
    return {'label': group.label, 'rows': group.rows, 'rms': rms}


def remarks(result: Attribution) -> list[dict[str, Any]]:
    """Return the paper's remarks about the filters, each with our number."""
    by = {(c.filter, c.preset, c.data): c for c in result.costs}
    efforts = {(e.filter, e.preset): e for e in result.efforts}
    rows: list[dict[str, Any]] = []
    ahrs, complementary = (
        by.get(('ahrs', 'paper', 'raw')),
        by.get(('complementary', 'paper', 'raw')),
    )
    if ahrs and complementary:
        both = [by[name, 'paper', 'compensated'] for name in ('ahrs', 'complementary')]
        rows.append(
            {
                'remark': 'AHRS suffers more from temperature',
                'ours': {'ahrs': both[0].moved['total'], 'complementary': both[1].moved['total']},
                'unit': 'deg',
                'holds': both[0].moved['total'] > both[1].moved['total'],
            }
        )
    singles = [c for (f, p, d), c in by.items() if f == 'ahrs' and p == 'paper' and ' ' in d]
    if singles:
        most = max(singles, key=lambda cost: cost.moved['total'])
        rows.append(
            {
                'remark': 'because of the magnetometer',
                'ours': {c.data.split()[0]: c.moved['total'] for c in singles},
                'unit': 'deg',
                'holds': most.data.startswith('magnetometer') and most.moved['total'] > 0,
            }
        )
    if ('ahrs', 'paper') in efforts and ('complementary', 'paper') in efforts:
        a, c = efforts['ahrs', 'paper'], efforts['complementary', 'paper']
        for unit, attribute_name in (('ns', 'nanoseconds_per_sample'), ('B', 'state_bytes')):
            ours = {
                'ahrs': getattr(a, attribute_name),
                'complementary': getattr(c, attribute_name),
            }
            rows.append(
                {
                    'remark': 'AHRS costs more',
                    'ours': ours,
                    'unit': unit,
                    'holds': ours['ahrs'] > ours['complementary'],
                }
            )
    return rows
