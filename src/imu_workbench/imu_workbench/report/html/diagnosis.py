# SPDX-License-Identifier: Apache-2.0
"""Sections on what a model misses: diagnosis, error after each step, growth of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.presentation.diagnosis import NOTHING_MISSING, VERDICTS, percent, verdict_line
from thermal_comp.presentation.display import DISPLAY_UNITS, shown, with_uncertainty

from imu_workbench.report.error_steps import degree_steps
from imu_workbench.report.figures.attitude import FILTER_NAMES
from imu_workbench.report.figures.error_steps import error_steps_figure
from imu_workbench.report.figures.modelled import failure_figure
from imu_workbench.report.html.render import Section

VERDICT_CLASSES = {
    'complete': 'supported',
    **dict.fromkeys(('changed', 'missing', 'ambiguous', 'unexplained', 'unlogged'), 'not'),
}
"""Verdict → CSS class; others have the class `open`."""
MOST_RIVALS = 3
"""Rivals of a finding that are named."""


def diagnosis_section(content: Mapping[str, Any]) -> Section | None:
    """Return diagnosis and error steps of every device."""
    stairs = content['staircase']
    if not stairs and not content['diagnosis']:
        return None
    values = {
        'diagnoses': [
            diagnosis_values(found, content['models'].get(device, {}).get('shapes', ()))
            for device, found in content['diagnosis'].items()
        ],
        'devices': list(stairs),
        'degrees': [{'device': n, **degree_table(found)} for n, found in stairs.items()],
        'filtered': any(found['degrees'] for found in stairs.values()),
    }
    figures = {
        f'stairs|{name}': error_steps_figure(found['sensors'] | degree_steps(found))
        for name, found in stairs.items()
    }
    title = 'Diagnosis: what the model misses'
    return Section('diagnosis', title, 'diagnosis.html', values, figures, short='Diagnosis')


def diagnosis_values(
    found: Mapping[str, Any], shapes: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return verdict, findings and what could not be tried, of one device.

    `shapes` are the shape parameters of its certified model.
    """
    verdict = found['verdict']
    complete = verdict in NOTHING_MISSING
    words = verdict_line(found) if complete else VERDICTS.get(verdict, verdict)
    greyed = '; '.join(f'{name} {reason}' for name, reason in found['greyed_out'].items())
    notes = [*([f'not tried: {greyed}'] if greyed else []), *found['undetermined']]
    return {
        'device': found['device'],
        'verdict': words,
        'look': VERDICT_CLASSES.get(verdict, 'open'),
        'findings': [
            {
                'text': _finding_text(finding),
                'detail': ' · '.join(_finding_details(finding, shapes)),
            }
            for finding in found['findings']
        ],
        'notes': [note.replace('_', ' ') for note in notes],
    }


def _finding_text(finding: Mapping[str, Any]) -> str:
    name = f'{finding["name"]}: ' if finding['kind'] == 'data_quality' else ''
    return f'{name}{finding["text"]}'.replace('_', ' ')


def _finding_details(finding: Mapping[str, Any], shapes: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return evidence, errors, shape parameters and rivals of a finding.

    A parameter of the certified model has its value there.
    """
    evidence = f'evidence {shown(finding["evidence"])}'
    if finding['threshold']:
        evidence += f', needed {shown(finding["threshold"])}'
    known = finding['probability']
    details = [evidence if known is None else f'probability {percent(known)}, {evidence}']
    unit = DISPLAY_UNITS.get(finding['sensor'].split('+')[0])
    if unit and finding['error_after'] is not None:
        before, after, floor = (
            shown((finding[key] or 0.0) * unit.factor)
            for key in ('error_before', 'error_after', 'noise_floor')
        )
        details.append(f'held-out error {before} → {after} {unit.unit}, noise floor {floor}')
    certified = {
        shape['parameter']: shape
        for shape in shapes
        if shape['effect'] == finding['name'] and shape['sensor'] in finding['sensor'].split('+')
    }
    details += [
        f'{name.replace("_", " ")} = {_value(value["value"], value["std"])} {value["unit"]}'
        + (' (± one standard deviation)' if value['std'] else '')
        for name, value in (finding['parameters'] | certified).items()
    ]
    if finding['rivals']:
        rivals = finding['rivals'][:MOST_RIVALS]
        named = ', '.join(f'{rival["name"]} {percent(rival["probability"])}' for rival in rivals)
        details.append(f'in its place: {named.replace("_", " ")}')
    return details


def _value(value: Any, uncertainty: Any) -> str:
    if not isinstance(value, list | tuple):
        return with_uncertainty(value, uncertainty)
    each = uncertainty or [None] * len(value)
    return f'({", ".join(map(with_uncertainty, value, each))})'


def degree_table(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return σ of the rotation angle per run and filter, raw and under every version."""
    rows = [
        [
            f'{_marked(row)}, {FILTER_NAMES.get(row["filter"], row["filter"])}',
            *map(shown, row['sigma']),
        ]
        for row in found['degrees']
    ]
    return {
        'head': ['Run, filter', *(f'{name} [°]' for name in found['versions'])],
        'rows': rows,
        'interpolated': any(row['interpolated'] for row in found['degrees']),
    }


def _marked(row: Mapping[str, Any]) -> str:
    return f'{row["run"]} ‡' if row['interpolated'] else f'{row["run"]}'


def growth_section(content: Mapping[str, Any]) -> Section | None:
    """Return the growth of a model: its lines, maps before and after, the error steps."""
    growth = content.get('growth')
    if not growth:
        return None
    figures = {
        f'map|{sensor}': failure_figure(
            {
                'line per axis': part['maps']['before'],
                'with the named effect': part['maps']['after'],
            }
        )
        for sensor, part in growth['sensors'].items()
        if part['maps']['before'] and part['maps']['after']
    }
    values = {
        'lines': growth['lines'],
        'sensors': [key.partition('|')[2] for key in figures],
        'degrees': degree_table(growth) if growth['sensors'] else None,
    }
    if growth['sensors']:
        figures['stairs|growth'] = error_steps_figure(growth['sensors'] | degree_steps(growth))
    title = 'A hidden effect, found and removed'
    return Section('growth', title, 'model_growth.html', values, figures, 'Hidden effect')
