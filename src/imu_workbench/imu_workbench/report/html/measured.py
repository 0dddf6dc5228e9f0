# SPDX-License-Identifier: Apache-2.0
"""Sections of the page about what was measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.presentation.display import duration, fixed, shown

from imu_workbench.report.figures.measured import cycle_figure, plan_figure
from imu_workbench.report.html.render import Row, Section, figure_of_paper

DECIMALS = {'°/s': 3, 'm/s²': 3, 'µT': 2}
"""Decimals of Tables III–V: one more than the paper prints for the two inertial sensors."""
PAPER_DECIMALS = 2
TRACK_CAPTIONS = {
    'set-point': 'set-point as programmed',
    'chamber air': 'air as the chamber measures it',
    'thermocouple on the device': 'thermocouple on the device',
    'die': 'die as the device itself says',
}
"""Tracks of the plan's figure and what its caption says of them."""
SEGMENT_NAMES = {'reference': 'Reference'}


def plan_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of Fig. 1."""
    plans = {run['name']: run['plan'] for run in content['recordings'] if run['plan']}
    if not plans:
        return None
    first = next(iter(plans.values()))
    drawn = {name for plan in plans.values() for name in plan['tracks']}
    values = {
        'runs': list(plans),
        'cycles': first['cycles'],
        'hours': fixed(first['duration_h'], 2),
        'dwells': any(leg['phase'].startswith('dwell') for leg in first['phases']),
        'tracks': ', '.join(TRACK_CAPTIONS[name] for name in TRACK_CAPTIONS if name in drawn),
        'paper_hours': shown(first['paper_duration_h'], 2),
        'overheating': overheating_rows(content),
        'figure': figure_of_paper(content, 1),
    }
    figures = {f'plan|{name}': plan_figure(plan) for name, plan in plans.items()}
    title = 'The plan' if 'set-point' in drawn else 'Temperatures over the runs'
    return Section('plan', title, 'plan.html', values, figures)


def overheating_rows(content: Mapping[str, Any]) -> list[Row]:
    """Return how much warmer device and die of each run are than the air, where that is known."""
    return [
        [
            run['name'],
            *(
                f'{fixed(found["mean_k"], 2)} ± {fixed(found["std_k"], 2)}' if found else '–'
                for found in (run['overheating'].get(k) for k in ('thermocouple', 'die'))
            ),
        ]
        for run in content['recordings']
        if run['overheating']
    ]


def statistics_section(content: Mapping[str, Any]) -> Section:
    """Return Tables III–V, ours beside the paper's, and the overall ranges."""
    runs = content['statistics']
    sensors = list(dict.fromkeys(sensor for run in runs for sensor in run['sensors']))
    values = {
        'choices': {'Run': [run['name'] for run in runs], 'Sensor': sensors},
        'parts': [
            {
                'key': f'{run["name"]}|{sensor}',
                'sensor': sensor,
                'tables': statistics_tables(content, run, sensor),
            }
            for run in runs
            for sensor in sensors
        ],
        'ranges': range_rows(content),
    }
    return Section('statistics', 'Tables III–V', 'statistics.html', values)


def statistics_tables(
    content: Mapping[str, Any], run: Mapping[str, Any], sensor: str
) -> list[dict[str, Any]]:
    """Return our table of one run and sensor, and the paper's of the same axis where it has one.

    Nothing where the run has no data of the sensor.
    """
    if sensor not in run['sensors']:
        return []
    ours = run['sensors'][sensor]
    tables = [statistics_table(ours, f'Ours: {run["name"]}', DECIMALS[ours['unit']])]
    published = content['published_statistics'].get(run['published'])
    if published:
        caption = f'Paper, Table {run["published"]} ({published["device"]}, {published["up"]} up)'
        tables.append(statistics_table(published['sensors'][sensor], caption, PAPER_DECIMALS))
    return tables


def statistics_table(table: Mapping[str, Any], caption: str, decimals: int) -> dict[str, Any]:
    """Return one sensor's table: a row per axis, four numbers per segment."""
    segments = list(dict.fromkeys(row['segment'] for row in table['rows']))
    by_place = {(row['axis'], row['segment']): row for row in table['rows']}
    return {
        'caption': f'{caption} [{table["unit"]}]',
        'head': [
            ['Axis', *((SEGMENT_NAMES.get(segment, segment), 4) for segment in segments)],
            ['', *(['Min', 'Max', 'Mean', 'σ'] * len(segments))],
        ],
        'rows': [
            [
                axis,
                *(
                    fixed(by_place[axis, segment][name], decimals)
                    for segment in segments
                    for name in ('min', 'max', 'mean', 'std')
                ),
            ]
            for axis in 'xyz'
        ],
    }


def range_rows(content: Mapping[str, Any]) -> list[Row]:
    """Return the largest range of any channel per sensor, the paper's and ours."""
    return [
        [
            sensor.capitalize(),
            f'{found["paper"]:g} {found["unit"]}',
            f'{shown(found["without_start_up"])} {found["unit"]}',
            f'{shown(found["with_start_up"])} {found["unit"]}',
        ]
        for sensor, found in content['ranges'].items()
    ]


def cycle_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of Fig. 4."""
    cycles = {run['name']: run['cycle'] for run in content['recordings'] if run['cycle']}
    if not cycles:
        return None
    figures = {f'cycle|{name}': cycle_figure(cycle) for name, cycle in cycles.items()}
    some = has_cycles(content)
    values = {'runs': list(cycles), 'figure': figure_of_paper(content, 4), 'cycles': some}
    title = 'One cycle' if some else 'Every channel over the run'
    return Section('cycle', title, 'cycle.html', values, figures)


def has_cycles(content: Mapping[str, Any]) -> bool:
    """Tell whether the runs have thermal cycles."""
    return any(run['cycle'] and run['cycle']['cycle'] for run in content['recordings'])


def recordings_section(content: Mapping[str, Any]) -> Section:
    """Return what the report is made of, and what was dropped or inferred on the way."""
    rows = []
    for run in content['recordings']:
        span = run['temperature_range']
        cells = [
            run['name'],
            run['device'] or 'not told',
            (run['up_axis'] or '–').replace('-', '−'),
            fixed(run['samples'], 0),
            duration(run['duration_s']),
            f'{shown(run["rate_hz"])} Hz',
            f'{fixed(span[0], 1)} … {fixed(span[1], 1)} °C' if span else '–',
            'yes' if run['magnetometer_samples'] else 'none',
        ]
        rows.append({'cells': cells, 'sha256': run['sha256']})
    values = {'rows': rows, 'notes': notes(content)}
    return Section('recordings', 'Recordings', 'recordings.html', values)


def notes(content: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return every sentence about what was dropped, repaired or inferred, with its runs."""
    by_note: dict[str, list[str]] = {}
    for run in content['recordings']:
        for note in run['notes']:
            by_note.setdefault(note, []).append(run['name'])
        for name, count in run['unplaced'].items():
            if any(name in note for note in run['notes']):
                continue  # more than a few stand among the notes
            note = f'{name}: {count} {"sample" if count == 1 else "samples"} without a row'
            by_note.setdefault(note, []).append(run['name'])
    total = len(content['recordings'])
    return [{'text': note, 'runs': _runs(names, total)} for note, names in by_note.items()]


def _runs(names: Sequence[str], total: int) -> str:
    if len(names) == total and total > 1:
        return f'all {total} runs'
    return ', '.join(names)
