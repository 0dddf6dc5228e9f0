# SPDX-License-Identifier: Apache-2.0
"""A comparison, and the effects added to a model with the fall of the error, as lines of text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from typing import Any

from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown, with_uncertainty

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


def growth_text(content: Mapping[str, Any]) -> str:
    """Return the steps and the comparison after them as lines."""
    lines = []
    for step in content['steps']:
        unit = DISPLAY_UNITS[step['sensor'].split('+')[0]]
        before, after, floor = (
            shown(step[key] * unit.factor)
            for key in ('error_before', 'error_after', 'noise_floor')
        )
        rivals = step['ambiguous_with']
        doubt = f' (or {" or ".join(rivals)}: cannot be told apart here)' if rivals else ''
        lines.append(
            f'added {step["added"]} to the {step["sensor"]}{doubt}: held-out error '
            f'{before} → {after} {unit.unit}, noise floor {floor} '
            f'({step["error_after"] / step["noise_floor"]:.2f} floors are left)'
        )
    if not content['steps']:
        lines.append('nothing was added')
    lines += shape_lines(content['parameters'])
    lines += [f'no longer needed: {name}' for name in content['unneeded']]
    lines.append(comparison_text(content))
    lines += [f'note: {note}' for note in dict.fromkeys(content['undetermined'])]
    return '\n'.join(lines)


def shape_lines(parameters: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return one line per fitted shape parameter: its value and standard deviation."""
    lines = []
    for row in parameters:
        values, spread = (v if isinstance(v, list) else [v] for v in (row['value'], row['std']))
        pairs = zip_longest(values, spread[: len(values)])
        said = ', '.join(with_uncertainty(value, std) for value, std in pairs)
        name = row['parameter'].replace('_', ' ')
        lines.append(f'{row["sensor"]}, {row["effect"]}: {name} {said} {row["unit"]}')
    return lines
