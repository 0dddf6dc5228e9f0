# SPDX-License-Identifier: Apache-2.0
"""A comparison of model and measurement as lines for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imu_workbench.display import DISPLAY_UNITS, SENSORS, shown

COLUMNS = {
    'measured_rms': 'measured',
    'residual_rms': 'residual',
    'held_out_rms': 'held out',
    'noise_floor': 'floor',
}


def comparison_text(found: Mapping[str, Any]) -> str:
    """Return the comparison (the dictionary that --json writes) as a table."""
    head = ''.join(f'{label:>11}' for label in COLUMNS.values())
    name = found.get('device') or 'device'
    lines = [f'{name + ", rms of 20 s means":<30}{head}  unit   worst phase']
    for sensor in (s for s in SENSORS if s in found['sensors']):
        part, unit = found['sensors'][sensor], DISPLAY_UNITS[sensor]
        for i, axis in enumerate('xyz'):
            values = [part[key][i] for key in COLUMNS]
            numbers = ''.join(f'{shown(_times(value, unit.factor)):>11}' for value in values)
            place = (part['worst_phase'] or '').replace('_', ' ')
            lines.append(f'  {sensor:<26}{axis:<2}{numbers}  {unit.unit:<6} {place}')
    return '\n'.join(lines)


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor
