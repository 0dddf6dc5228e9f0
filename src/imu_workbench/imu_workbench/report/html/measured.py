# SPDX-License-Identifier: Apache-2.0
"""Sections of the page about what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from thermal_comp.presentation.display import duration, fixed, shown

from imu_workbench.report.figures.measured import cycle_figure, plan_figure
from imu_workbench.report.html.render import Choice, Section, group_html, table_html

DECIMALS = {'°/s': 3, 'm/s²': 3, 'µT': 2}
"""Decimals of Tables III–V: one more than the paper prints for the two inertial sensors."""
SEGMENT_NAMES = {'reference': 'Reference'}


def plan_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of Fig. 1."""
    plans = {run['name']: run['plan'] for run in content['recordings'] if run['plan']}
    if not plans:
        return None
    first = next(iter(plans.values()))
    legs = f'{first["cycles"]} cycles, ' if first['cycles'] else ''
    said = (
        f'<p>{legs}{fixed(first["duration_h"], 2)} h in all (the paper says approximately '
        f'{shown(first["paper_duration_h"], 2)} h; its legs add up to 10.5 h plus the '
        'preconditioning, whose length it does not state). Grey: dwells.</p>'
    )
    caption = (
        'Fig. 1. Temperatures over the run. Set-point as programmed, air as the chamber '
        'measures it, thermocouple on the device, die as the device itself says.'
    )
    group = group_html('plan', [Choice('Run', list(plans))], caption, 'Temperatures over the run')
    figures = {f'plan|{name}': plan_figure(plan) for name, plan in plans.items()}
    return Section('plan', 'The plan', said + group + overheating_html(content), figures)


def overheating_html(content: Mapping[str, Any]) -> str:
    """Return the table of device and die above air, '' where no air was logged."""
    rows = [
        [
            escape(run['name']),
            *(
                f'{fixed(found["mean_k"], 2)} ± {fixed(found["std_k"], 2)}' if found else '–'
                for found in (run['overheating'].get(k) for k in ('thermocouple', 'die'))
            ),
        ]
        for run in content['recordings']
        if run['overheating']
    ]
    if not rows:
        return ''
    head = [['Run', 'thermocouple − air [K]', 'die − air [K]']]
    return table_html(
        head, rows, caption='Overheating while the chamber dwells (mean ± standard deviation)'
    )


def statistics_section(content: Mapping[str, Any]) -> Section:
    """Return Tables III–V, ours beside the paper's, and the overall ranges."""
    names = [run['name'] for run in content['statistics']]
    sensors = list(dict.fromkeys(s for run in content['statistics'] for s in run['sensors']))
    parts = []
    for run in content['statistics']:
        for sensor in sensors:
            key = f'{run["name"]}|{sensor}'
            if sensor not in run['sensors']:
                parts.append(f'<p data-key="{escape(key)}">This run has no {sensor} data.</p>')
                continue
            ours = run['sensors'][sensor]
            decimals = DECIMALS[ours['unit']]
            parts.append(statistics_table(ours, key, f'Ours: {run["name"]}', decimals))
            name = run['published']
            published = content['published_statistics'].get(name)
            if published:
                caption = f'Paper, Table {name} ({published["device"]}, {published["up"]} up)'
                parts.append(statistics_table(published['sensors'][sensor], key, caption, 2))
    group = group_html(
        'statistics',
        [Choice('Run', names), Choice('Sensor', sensors)],
        '',
        '',
        parts=''.join(parts),
    )
    said = (
        '<p>Minimum, maximum, mean and standard deviation of every channel; the quiet zone at '
        'ambient temperature is the Reference, R1 … the cycles. Start-up samples are left out: '
        'in the published tables they set minimum and standard deviation of every large channel. '
        'The paper’s table of the same axis stands below ours. Other devices, other numbers: what '
        'can be compared is the size of the changes.</p>'
    )
    return Section('statistics', 'Tables III–V', said + ranges_html(content) + group)


def statistics_table(table: Mapping[str, Any], key: str, caption: str, decimals: int) -> str:
    """Return one sensor's table: a row per axis, four numbers per segment."""
    unit, rows = table['unit'], table['rows']
    segments = list(dict.fromkeys(row['segment'] for row in rows))
    by_place = {(row['axis'], row['segment']): row for row in rows}
    head = [
        ['Axis', *(f'{SEGMENT_NAMES.get(segment, segment)}|4' for segment in segments)],
        ['', *(['Min', 'Max', 'Mean', 'σ'] * len(segments))],
    ]
    body = [
        [
            axis,
            *(
                fixed(by_place[axis, segment][name], decimals)
                for segment in segments
                for name in ('min', 'max', 'mean', 'std')
            ),
        ]
        for axis in 'xyz'
    ]
    return table_html(head, body, caption=f'{escape(caption)} [{unit}]', key=key, dense=True)


def ranges_html(content: Mapping[str, Any]) -> str:
    """Return the table of overall ranges."""
    rows = [
        [
            sensor.capitalize(),
            f'{found["paper"]:g} {found["unit"]}',
            f'{shown(found["without_start_up"])} {found["unit"]}',
            f'{shown(found["with_start_up"])} {found["unit"]}',
        ]
        for sensor, found in content['ranges'].items()
    ]
    head = [['Largest range of any channel', 'paper', 'ours', 'ours with start-up samples']]
    return table_html(head, rows) if rows else ''


def cycle_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of Fig. 4."""
    cycles = {run['name']: run['cycle'] for run in content['recordings'] if run['cycle']}
    if not cycles:
        return None
    caption = (
        'Fig. 4. One thermal cycle: each channel as deviation from its mean in the cycle. Bold: '
        '20 s means; pale: samples, decimated so that every extreme is kept; dashed: die '
        'temperature (right axis).'
    )
    group = group_html('cycle', [Choice('Run', list(cycles))], caption, 'One thermal cycle')
    figures = {f'cycle|{name}': cycle_figure(cycle) for name, cycle in cycles.items()}
    return Section('cycle', 'One cycle', group, figures)


def recordings_section(content: Mapping[str, Any]) -> Section:
    """Return what the report is made of and what was dropped or inferred on the way."""
    rows = []
    for run in content['recordings']:
        span = run['temperature_range']
        rows.append(
            [
                escape(run['name']),
                escape(run['device'] or 'not told'),
                escape(run['up_axis'] or '–').replace('-', '−'),
                fixed(run['samples'], 0),
                duration(run['duration_s']),
                f'{shown(run["rate_hz"])} Hz',
                f'{fixed(span[0], 1)} … {fixed(span[1], 1)} °C' if span else '–',
                'yes' if run['magnetometer_samples'] else 'none',
                f'<code title="{run["sha256"]}">{run["sha256"][:12]}</code>',
            ]
        )
    head = [[
        'Run', 'device', 'up', 'samples', 'duration', 'rate', 'die temperature', 'magnetometer',
        'SHA-256 of the columns',
    ]]  # fmt: skip
    return Section('recordings', 'Recordings', table_html(head, rows) + notes_html(content))


def notes_html(content: Mapping[str, Any]) -> str:
    """Return every sentence about what was dropped, repaired or inferred, runs joined."""
    by_note: dict[str, list[str]] = {}
    for run in content['recordings']:
        for note in run['notes']:
            by_note.setdefault(note, []).append(run['name'])
        for name, count in run['unplaced'].items():
            if any(name in note for note in run['notes']):
                continue  # more than a few stand among the notes
            note = f'{name}: {count} {"sample" if count == 1 else "samples"} without a row'
            by_note.setdefault(note, []).append(run['name'])
    if not by_note:
        return '<p class="soft">Nothing was dropped or repaired.</p>'
    total = len(content['recordings'])
    items = ''.join(
        f'<li>{escape(note)} <span class="soft">({_runs(names, total)})</span></li>'
        for note, names in by_note.items()
    )
    return f'<h3>What was dropped, repaired or inferred</h3><ul class="plain">{items}</ul>'


def _runs(names: Sequence[str], total: int) -> str:
    if len(names) == total and total > 1:
        return f'all {total} runs'
    return escape(', '.join(names))
