# SPDX-License-Identifier: Apache-2.0
"""The report's page and its summary for the terminal, from the same content."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from thermal_comp.presentation.comparison import comparison_text
from thermal_comp.presentation.diagnosis import diagnosis_text
from thermal_comp.presentation.display import shown

from imu_workbench.report.claims.claim import VERDICT_NAMES
from imu_workbench.report.figures.attitude import FILTER_NAMES
from imu_workbench.report.html.attitude import attitude_section
from imu_workbench.report.html.certificate import (
    allan_section,
    budget_section,
    certificate_section,
)
from imu_workbench.report.html.claims import (
    claims_section,
    paper_section,
    reproduce_section,
    summary_section,
)
from imu_workbench.report.html.diagnosis import diagnosis_section, growth_section
from imu_workbench.report.html.measured import (
    cycle_section,
    plan_section,
    recordings_section,
    statistics_section,
)
from imu_workbench.report.html.modelled import (
    comparison_section,
    dependence_section,
    fit_section,
    model_section,
)
from imu_workbench.report.html.render import Section, render_page


def report_page(content: Mapping[str, Any]) -> str:
    """Return the page as one HTML text that needs no network."""
    sections = (
        *(certificate_section(found) for found in content['certificates'].values()),
        summary_section(content),
        comparison_section(content),
        model_section(content),
        budget_section(content['certificates']),
        allan_section(content['certificates']),
        diagnosis_section(content),
        dependence_section(content),
        fit_section(content),
        plan_section(content),
        cycle_section(content),
        attitude_section(content),
        growth_section(content),
        *(paper_annex(content) if content['follows_paper'] else ()),
        recordings_section(content),
        reproduce_section(content),
    )
    names = [device['name'] for device in content['devices']]
    count = len(content['recordings'])
    subtitle = f'{", ".join(names)} · {count} {"run" if count == 1 else "runs"}'
    return render_page(content['title'], subtitle, [s for s in sections if s])


def paper_annex(content: Mapping[str, Any]) -> tuple[Section | None, ...]:
    """Return the comparison with the paper: its claims, its tables, its own numbers."""
    return claims_section(content), statistics_section(content), paper_section(content)


def report_text(content: Mapping[str, Any]) -> str:
    """Return the summary for the terminal."""
    lines = [content['lead'], '']
    for name, found in content['certificates'].items():
        lines += [f'{name}: {found["conclusion"]}', '']
    for found in content['comparison'].values():
        lines += [comparison_text(found), '']
    for found in content['diagnosis'].values():
        lines += [diagnosis_text(found), '']
    for device in content['devices']:
        said = [device[kind] for kind in ('problem', 'note') if device[kind]]
        lines += [f'{device["name"]}: {text}' for text in said]
    lines += content['left_out']
    lines += note_lines(content)
    lines += attitude_lines(content)
    lines += ['', 'Claims of the paper:'] if content['follows_paper'] else []
    for claim in content['claims'] if content['follows_paper'] else ():
        lines.append(f'  [{VERDICT_NAMES[claim["verdict"]]}] {claim["claim"]}')
        if claim['ours'] != '–':
            lines.append(f'      {claim["ours"]}')
    return '\n'.join(lines)


def note_lines(content: Mapping[str, Any]) -> list[str]:
    """Return what was left out or inferred on reading, each once."""
    runs: dict[str, list[str]] = {}
    for recording in content['recordings']:
        for note in recording['notes']:
            runs.setdefault(note, []).append(recording['name'])
    said = [f'  {note} ({", ".join(names)})' for note, names in runs.items()]
    return ['', 'Notes on the recordings:', *said] if said else []


def attitude_lines(content: Mapping[str, Any]) -> list[str]:
    """Return σ of the rotation angle, raw and compensated, of every run and filter."""
    lines = []
    for run in content['attitudes']:
        spread = {
            (f['filter'], f['data']): f['statistics'][0].get('std', {}).get('rotation')
            for f in run['filters']
        }
        for name in dict.fromkeys(f['filter'] for f in run['filters']):
            mark = '  (interpolated: no verdict)' if run['interpolated'] else ''
            before, after = shown(spread[name, 'raw']), shown(spread[name, 'compensated'])
            label = FILTER_NAMES.get(name, name)
            lines.append(f'  {run["name"]:<14}{label:<22}{before:>7}° → {after:>7}°{mark}')
    title = 'Attitude of the resting device, σ of the rotation angle, raw → compensated:'
    return ['', title, *lines] if lines else []
