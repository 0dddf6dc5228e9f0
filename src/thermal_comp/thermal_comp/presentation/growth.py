# SPDX-License-Identifier: Apache-2.0
"""Effects added to a model and the fall of the error, as text, table and picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from textwrap import fill
from typing import TYPE_CHECKING, Any

from thermal_comp.presentation.comparison import comparison_text
from thermal_comp.presentation.display import DISPLAY_UNITS, shown, with_uncertainty
from thermal_comp.presentation.html_table import html_table

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture

ERROR_KEYS = ('error_before', 'error_after', 'noise_floor')
"""Errors of a step, in the dictionary of a growth."""


def growth_text(content: Mapping[str, Any]) -> str:
    """Return the steps and the comparison after them as lines."""
    lines = []
    for step in content['steps']:
        unit = DISPLAY_UNITS[step['sensor'].split('+')[0]]
        before, after, floor = (shown(step[key] * unit.factor) for key in ERROR_KEYS)
        rivals = step['ambiguous_with']
        doubt = f' (or {" or ".join(rivals)}: cannot be told apart here)' if rivals else ''
        lines.append(
            f'{_change(step)}{doubt}: held-out error '
            f'{before} → {after} {unit.unit}, noise floor {floor} '
            f'({step["error_after"] / step["noise_floor"]:.2f} floors are left)'
            f'{_doubt_about_fall(step)}'
        )
    if not content['steps']:
        lines.append('nothing was added')
    lines += shape_lines(content['parameters'])
    lines += [f'no longer needed: {name}' for name in content['unneeded']]
    lines.append(comparison_text(content))
    lines += [f'note: {note}' for note in dict.fromkeys(content['undetermined'])]
    return '\n'.join(lines)


def _change(step: Mapping[str, Any]) -> str:
    """Return what a step did to the model of a sensor."""
    left = ', '.join(step['replaced'])
    if not step['added']:
        return f'left {left} out of the {step["sensor"]}'
    added = f'{step["added"]}, cause undecided,' if step['empirical'] else step['added']
    return f'added {added} to the {step["sensor"]}' + (f' in place of {left}' if left else '')


def _signed(step: Mapping[str, Any]) -> str:
    """Return what a step added with +, and what it left out with −."""
    added = [f'+\u00a0{step["added"]}'] if step['added'] else []
    return ', '.join([*added, *(f'−\u00a0{name}' for name in step['replaced'])])


def _doubt_about_fall(step: Mapping[str, Any]) -> str:
    """Return a remark where the held-out error falls no more than by chance; '' elsewhere."""
    if step['lowered']:
        return ''
    if step['error_after'] >= step['error_before']:
        return ': no gain on held-out parts'
    return f': lower in {step["parts_lowered"]} of {step["parts"]} held-out parts, may be chance'


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


text = growth_text


def table(content: Mapping[str, Any]) -> str:
    """Return the steps as an HTML table."""
    head = ['added', 'sensor', 'held-out error before', 'after', 'noise floor', 'unit', 'or']
    rows = []
    for step in content['steps']:
        unit = DISPLAY_UNITS[step['sensor'].split('+')[0]]
        values = [shown(step[key] * unit.factor) for key in ERROR_KEYS]
        rivals = ', '.join(step['ambiguous_with'])
        rows.append([_signed(step), step['sensor'], *values, unit.unit, rivals])
    notes = [*shape_lines(content['parameters']), *dict.fromkeys(content['undetermined'])]
    title = 'added to the model' if rows else 'nothing was added'
    return html_table(title, head, rows, notes)


def picture(growth: Any) -> Picture:
    """Return the steps the held-out error takes towards the noise floor, a panel a sensor."""
    from thermal_comp.presentation.picture import new_picture

    steps: dict[str, list[Mapping[str, Any]]] = {}
    for step in growth.to_dict()['steps']:
        steps.setdefault(step['sensor'], []).append(step)
    figure, panels = new_picture(max(len(steps), 1))
    for panel, (sensor, taken) in zip(panels, steps.items(), strict=False):
        unit = DISPLAY_UNITS[sensor.split('+')[0]]
        errors = [taken[0]['error_before'], *(step['error_after'] for step in taken)]
        labels = ['before', *(fill(_signed(step).replace('_', ' '), 13) for step in taken)]
        values = [error * unit.factor for error in errors]
        panel.bar(range(len(values)), values, 0.6)
        for place, value in enumerate(values):
            panel.annotate(shown(value), (place, value), ha='center', va='bottom')
        floor = taken[-1]['noise_floor'] * unit.factor
        panel.axhline(floor, color='k', ls='--', lw=1, label='noise floor')
        panel.set_xticks(range(len(values)), labels, fontsize='small')
        panel.set(title=sensor, yscale='log', ylabel=f'held-out error [{unit.unit}]')
        panel.set_ylim(0.3 * min(floor, *values), 2.0 * max(values))
        panel.legend(fontsize='small')
    if not steps:
        panels[0].set_title('nothing was added')
    return figure
