# SPDX-License-Identifier: Apache-2.0
"""Sections on what a model misses: diagnosis, error after each step, growth of a model."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from thermal_comp.presentation.diagnosis import VERDICTS
from thermal_comp.presentation.display import DISPLAY_UNITS, shown, with_uncertainty

from imu_workbench.report.error_steps import degree_steps
from imu_workbench.report.figures.attitude import FILTER_NAMES
from imu_workbench.report.figures.error_steps import staircase_figure
from imu_workbench.report.figures.modelled import failure_figure
from imu_workbench.report.html.render import Choice, Section, figure_html, group_html, table_html

GOOD = ('complete',)
BAD = ('missing', 'ambiguous', 'unexplained', 'unlogged')


def diagnosis_section(content: Mapping[str, Any]) -> Section | None:
    """Return diagnosis and staircase of every device."""
    stairs = content['staircase']
    if not stairs and not content['diagnosis']:
        return None
    body = ''.join(map(diagnosis_html, content['diagnosis'].values()))
    figures = {}
    if stairs:
        figures = {
            f'stairs|{name}': staircase_figure(found['sensors'] | degree_steps(found))
            for name, found in stairs.items()
        }
        filtered = any(found['degrees'] for found in stairs.values())
        in_degrees = ' In degrees: what both filters make of each version.' if filtered else ''
        body += '<h3>How the error falls</h3>' + group_html(
            'stairs',
            [Choice('Device', list(stairs))],
            'Error staircase on a logarithmic scale: what was measured, what each version of the '
            'model leaves on data it has not seen, hatched what adding the named effects would '
            f'leave. Dashed: the noise floor.{in_degrees}',
            'Error after each step of the model',
            parts=''.join(degrees_html(name, found) for name, found in stairs.items()),
        )
    return Section(
        'diagnosis', 'Diagnosis: what the model misses', body, figures, short='Diagnosis'
    )


def diagnosis_html(found: Mapping[str, Any]) -> str:
    """Return verdict, findings and what could not be tried, of one device."""
    verdict = found['verdict']
    look = 'supported' if verdict in GOOD else 'not' if verdict in BAD else 'open'
    head = (
        f'<h3>{escape(found["device"])} <span class="verdict {look}">'
        f'{escape(VERDICTS.get(verdict, verdict))}</span></h3>'
    )
    items = ''.join(map(_finding_html, found['findings']))
    greyed = '; '.join(f'{name} {reason}' for name, reason in found['greyed_out'].items())
    notes = [*([f'not tried: {greyed}'] if greyed else []), *found['undetermined']]
    said = ''.join(f'<li>{escape(note.replace("_", " "))}</li>' for note in notes)
    return (
        f'{head}<ul class="claims">{items}</ul>'
        + (f'<ul class="plain soft small">{said}</ul>' if said else '')
    )  # fmt: skip


def _finding_html(finding: Mapping[str, Any]) -> str:
    lines = []
    unit = DISPLAY_UNITS.get(finding['sensor'].split('+')[0])
    if unit and finding['error_after'] is not None:
        before, after, floor = (
            shown((finding[key] or 0.0) * unit.factor)
            for key in ('error_before', 'error_after', 'noise_floor')
        )
        lines.append(f'held-out error {before} → {after} {unit.unit}, noise floor {floor}')
    lines += [
        f'{name.replace("_", " ")} = {_value(value["value"], value["std"])} {value["unit"]}'
        for name, value in finding['parameters'].items()
    ]
    if finding['rivals']:
        rivals = ', '.join(f'{r["name"]} {r["similarity"]:.0%}' for r in finding['rivals'][:3])
        lines.append(f'look-alikes: {rivals.replace("_", " ")}')
    evidence = f'evidence {shown(finding["evidence"])}'
    if finding['threshold']:
        evidence += f', needed {shown(finding["threshold"])}'
    detail = escape(' · '.join([evidence, *lines]))
    name = f'{finding["name"]}: ' if finding['kind'] == 'data_quality' else ''
    said = escape(f'{name}{finding["text"]}'.replace('_', ' '))
    return f'<li><b>{said}</b><p class="soft small">{detail}</p></li>'


def _value(value: Any, uncertainty: Any) -> str:
    if not isinstance(value, list | tuple):
        return with_uncertainty(value, uncertainty)
    each = uncertainty if isinstance(uncertainty, list | tuple) else [uncertainty] * len(value)
    return f'({", ".join(map(with_uncertainty, value, each))})'


def degrees_html(device: str, found: Mapping[str, Any]) -> str:
    """Return what every version of the model brings in degrees, per run and filter."""
    rows = [
        [
            f'{_run(row)}, {FILTER_NAMES.get(row["filter"], row["filter"])}',
            *map(shown, row['sigma']),
        ]
        for row in found['degrees']
    ]
    head = [['Run, filter', *(f'{escape(name)} [°]' for name in found['versions'])]]
    mark = ' (‡ interpolated to 50 Hz: no verdict)' if any(
        row['interpolated'] for row in found['degrees']
    ) else ''  # fmt: skip
    caption = f'In degrees: σ of the rotation angle, raw and under every version{mark}'
    return table_html(head, rows, caption=caption, key=device) if rows else ''


def _run(row: Mapping[str, Any]) -> str:
    return escape(row['run']) + (' ‡' if row['interpolated'] else '')


def story_section(content: Mapping[str, Any]) -> Section | None:
    """Return the story: its lines, the maps before and after, the staircase."""
    story = content.get('story')
    if not story:
        return None
    figures = {}
    body = f'<pre class="told">{escape(chr(10).join(story["lines"]))}</pre>'
    for sensor, part in story['sensors'].items():
        if part['maps']['before'] and part['maps']['after']:
            figures[f'map|{sensor}'] = failure_figure(
                {
                    'line per axis': part['maps']['before'],
                    'with the named effect': part['maps']['after'],
                }
            )
            body += figure_html(
                f'map|{sensor}',
                f'{escape(sensor.capitalize())}: residual over noise floor by phase and cycle, '
                'with the line per axis and with the named effect. The colours are those of every '
                'such map here: the calm end of the scale is noise alone.',
                f'Where the model of the {escape(sensor)} fails, before and after',
            )
    if story['sensors']:
        figures['stairs|story'] = staircase_figure(story['sensors'] | degree_steps(story))
        body += figure_html(
            'stairs|story',
            'The error after each step, in the unit of the sensor and in degrees of both filters. '
            'Dashed: the noise floor.',
            'Error after each step of the model',
        )
        body += degrees_html('', story)
    return Section('story', 'A hidden effect, found and removed', body, figures, 'Hidden effect')
