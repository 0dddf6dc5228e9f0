# SPDX-License-Identifier: Apache-2.0
"""The section of the page about attitude, with the tables of the paper where its plan was run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.presentation.display import fixed, shown

from imu_workbench.report.figures.attitude import FILTER_NAMES, attitude_figure
from imu_workbench.report.html.render import Row, Section, figure_of_paper

SHOWN_DATA = {
    'raw and compensated': ('raw', 'compensated'),
    'raw': ('raw',),
    'compensated': ('compensated',),
}
PAPER_TABLE_OF_DATA = {'raw': 'VI', 'compensated': 'VII'}
EULER = ('yaw', 'pitch', 'roll')
ROTATION_ANGLES = ('rotation', 'heading', 'inclination')
PUBLISHED_ANGLES = ('alpha', 'beta', 'gamma')


def attitude_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of both filters, raw and compensated."""
    runs = content['attitudes']
    if not runs:
        return None
    factors, cycle_factors = factor_rows(content)
    paper = content['follows_paper']
    values = {
        'figure': f'{figure_of_paper(content, 7)}{figure_of_paper(content, 8)}',
        'choices': {'Run': [run['name'] for run in runs], 'Data': list(SHOWN_DATA)},
        'slow_runs': [
            {'name': run['name'], 'rate': shown(run['rate_hz'])}
            for run in runs
            if run['interpolated']
        ],
        'shown_data': list(SHOWN_DATA),
        'tables': [
            {
                'data': data,
                'name': f'Table {name}. ' if paper else '',
                'rows': angle_rows(runs, data),
                'published': published_rows(content['published_attitudes'], data) if paper else [],
            }
            for data, name in PAPER_TABLE_OF_DATA.items()
        ],
        'factors': factors,
        'cycle_factors': cycle_factors,
        'cycles': cycle_rows(runs),
    }
    figures = {
        f'attitude|{run["name"]}|{label}': attitude_figure(run['series'], data)
        for run in runs
        for label, data in SHOWN_DATA.items()
    }
    title = 'Attitude: Fig. 7 and 8, Tables VI and VII' if paper else 'Attitude'
    return Section('attitude', title, 'attitude.html', values, figures, short='Attitude')


def angle_rows(runs: Sequence[Mapping[str, Any]], data: str) -> list[Row]:
    """Return mean and σ per run and filter over the whole run."""
    return [
        [_label(run, found['filter']), *_cells(found['statistics'][0])]
        for run in runs
        for found in run['filters']
        if found['data'] == data
    ]


def cycle_rows(runs: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return the same numbers cycle by cycle."""
    return [
        [f'{_label(run, found["filter"])}, {found["data"]}, {part["part"]}', *_cells(part)]
        for run in runs
        for found in run['filters']
        if found['data'] in PAPER_TABLE_OF_DATA
        for part in found['statistics'][1:]
    ]


def factor_rows(content: Mapping[str, Any]) -> tuple[list[Row], list[Row]]:
    """Return the factor by which each angle's σ shrinks: over the run, and cycle by cycle."""
    claim = next((c for c in content['claims'] if c['key'] == 'spread'), None)
    numbers = (claim or {}).get('numbers', {})
    over_run = [
        [f'{row["run"]}, {_filter(row["filter"])}', *map(shown, row['factor'].values())]
        for row in numbers.get('factors', [])
    ]
    by_cycle = [
        [
            f'{row["run"]} {row["cycle"]}, {_filter(row["filter"])}',
            *map(shown, row['factor'].values()),
        ]
        for row in numbers.get('cycles', [])
    ]
    return over_run, by_cycle if over_run else []


def published_rows(published: Sequence[Mapping[str, Any]], data: str) -> list[Row]:
    """Return the paper's table in the same columns."""
    by_place = {
        (row['dut'], row['filter'], row['euler_angle']): row
        for row in published
        if row['data'] == data
    }
    return [
        [
            f'{device}, {FILTER_NAMES[name]}',
            *(
                fixed(by_place[device, name, angle][kind], 1)
                for angle in PUBLISHED_ANGLES
                for kind in ('mean_deg', 'std_deg')
            ),
        ]
        for device, name in dict.fromkeys((device, name) for device, name, _ in by_place)
    ]


def _filter(name: str) -> str:
    return FILTER_NAMES.get(name, name)


def _label(run: Mapping[str, Any], name: str) -> str:
    mark = ' ‡' if run['interpolated'] else ''
    return f'{run["name"]}{mark}, {_filter(name)}'


def _cells(part: Mapping[str, Any]) -> list[str]:
    if 'mean' not in part:
        return ['–'] * 12
    cells = [fixed(part[kind][angle], 3) for angle in EULER for kind in ('mean', 'std')]
    return cells + [
        fixed(part[kind][a], 3) for a in ROTATION_ANGLES for kind in ('std', 'largest')
    ]
