# SPDX-License-Identifier: Apache-2.0
"""The section of the page about attitude: Fig. 7 and 8, Tables VI and VII."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from thermal_comp.presentation.display import fixed, shown

from imu_workbench.report.figures.attitude import FILTER_NAMES, attitude_figure
from imu_workbench.report.html.render import Choice, Section, group_html, table_html

SHOWN_DATA = {
    'raw and compensated': ('raw', 'compensated'),
    'raw (Fig. 7)': ('raw',),
    'compensated (Fig. 8)': ('compensated',),
}
EULER = {'yaw': 'α', 'pitch': 'β', 'roll': 'γ'}
BESIDE = {'rotation': 'rotation angle', 'heading': 'heading', 'inclination': 'inclination'}
INTERPOLATED = (
    'Measured below 50 Hz and interpolated linearly before the filters: no verdict on these '
    'degrees.'
)


def attitude_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of both filters, raw and compensated."""
    runs = content['attitudes']
    if not runs:
        return None
    figures = {
        f'attitude|{run["name"]}|{label}': attitude_figure(run['series'], data)
        for run in runs
        for label, data in SHOWN_DATA.items()
    }
    caption = (
        'Fig. 7 and 8. ZYX Euler angles of the resting device relative to its attitude in the '
        'first minute, about the sensor’s axes at the start; decimated so that every extreme is '
        'kept.'
    )
    warnings = ''.join(
        f'<p class="note" data-key="{escape(run["name"])}|{label}">{escape(run["name"])}: '
        f'{shown(run["rate_hz"])} Hz. {INTERPOLATED}</p>'
        for run in runs
        if run['interpolated']
        for label in SHOWN_DATA
    )
    choices = [Choice('Run', [run['name'] for run in runs]), Choice('Data', list(SHOWN_DATA))]
    body = '<p>The device rests: every degree away from the start is error.</p>'
    body += group_html('attitude', choices, caption, 'Attitude by both filters', parts=warnings)
    for data, table in (('raw', 'VI'), ('compensated', 'VII')):
        body += attitude_table(content, data, f'Table {table}. Angles on {data} data [°]')
        body += published_table(content, data, f'Paper, Table {table} [°]')
    body += factors_html(content) + cycles_html(content)
    title = 'Attitude: Fig. 7 and 8, Tables VI and VII'
    return Section('attitude', title, body, figures, short='Attitude')


def attitude_table(content: Mapping[str, Any], data: str, caption: str) -> str:
    """Return mean and σ per run and filter over the whole run."""
    rows = [
        [_label(run, found['filter']), *_cells(found['statistics'][0])]
        for run in content['attitudes']
        for found in run['filters']
        if found['data'] == data
    ]
    return table_html(_head(), rows, caption=caption + _marked(content), dense=True)


def factors_html(content: Mapping[str, Any]) -> str:
    """Return the factor by which each angle's σ shrinks."""
    claim = next((c for c in content['claims'] if c['key'] == 'spread'), None)
    factors = (claim or {}).get('numbers', {}).get('factors', [])
    if not factors:
        return ''
    rows = [
        [
            f'{escape(row["run"])}, {FILTER_NAMES.get(row["filter"], row["filter"])}',
            *map(shown, row['factor'].values()),
        ]
        for row in factors
    ]
    head = [['σ raw / σ compensated', 'α (yaw)', 'β (pitch)', 'γ (roll)']]
    table = table_html(head, rows, caption='Over the run')
    cycles = [
        [
            f'{escape(row["run"])} {row["cycle"]}, {_filter(row["filter"])}',
            *map(shown, row['factor'].values()),
        ]
        for row in (claim or {}).get('numbers', {}).get('cycles', [])
    ]
    return table + (table_html(head, cycles, caption='Cycle by cycle') if cycles else '')


def cycles_html(content: Mapping[str, Any]) -> str:
    """Return the same numbers cycle by cycle."""
    rows = []
    for run in content['attitudes']:
        for found in run['filters']:
            for part in found['statistics'][1:]:
                if found['data'] in ('raw', 'compensated'):
                    label = f'{_label(run, found["filter"])}, {found["data"]}, {part["part"]}'
                    rows.append([label, *_cells(part)])
    if not rows:
        return ''
    caption = 'Angles cycle by cycle [°]' + _marked(content)
    table = table_html(_head(), rows, caption=caption, dense=True)
    return f'<details><summary>Cycle by cycle</summary>{table}</details>'


def published_table(content: Mapping[str, Any], data: str, caption: str) -> str:
    """Return the paper's table in the same columns."""
    rows = []
    published = [row for row in content['published_attitudes'] if row['data'] == data]
    for device, name in dict.fromkeys((row['dut'], row['filter']) for row in published):
        cells = []
        for angle in ('alpha', 'beta', 'gamma'):
            row = next(
                r
                for r in published
                if (r['dut'], r['filter'], r['euler_angle']) == (device, name, angle)
            )
            cells += [fixed(row['mean_deg'], 1), fixed(row['std_deg'], 1)]
        rows.append([f'{device}, {FILTER_NAMES[name]}', *cells])
    head = [
        ['', *(f'{symbol}|2' for symbol in EULER.values())],
        ['Device, filter', *(['mean', 'σ'] * 3)],
    ]
    return table_html(head, rows, caption=caption)


def _filter(name: str) -> str:
    return escape(FILTER_NAMES.get(name, name))


def _label(run: Mapping[str, Any], name: str) -> str:
    mark = ' ‡' if run['interpolated'] else ''
    return f'{escape(run["name"])}{mark}, {escape(FILTER_NAMES.get(name, name))}'


def _marked(content: Mapping[str, Any]) -> str:
    if not any(run['interpolated'] for run in content['attitudes']):
        return ''
    return f' <span class="soft small">‡ {INTERPOLATED}</span>'


def _head() -> list[list[str]]:
    return [
        [
            '',
            *(f'{symbol} ({name})|2' for name, symbol in EULER.items()),
            *(f'{name}|2' for name in BESIDE.values()),
        ],
        ['Run, filter', *(['mean', 'σ'] * 3), *(['σ', 'largest'] * 3)],
    ]


def _cells(part: Mapping[str, Any]) -> list[str]:
    if 'mean' not in part:
        return ['–'] * 12
    cells = [fixed(part[kind][angle], 3) for angle in EULER for kind in ('mean', 'std')]
    return cells + [fixed(part[kind][a], 3) for a in BESIDE for kind in ('std', 'largest')]
