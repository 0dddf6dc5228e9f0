# SPDX-License-Identifier: Apache-2.0
"""What was added to a model and how far the error fell, as lines for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imu_workbench.comparison_text import comparison_text
from imu_workbench.display import DISPLAY_UNITS, shown


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
            f'{before} → {after} {unit.unit}, noise floor {floor}'
        )
    if not content['steps']:
        lines.append('nothing was added')
    lines += [f'no longer needed: {name}' for name in content['unneeded']]
    lines.append(comparison_text(content))
    lines += [f'note: {note}' for note in content['undetermined']]
    return '\n'.join(lines)
