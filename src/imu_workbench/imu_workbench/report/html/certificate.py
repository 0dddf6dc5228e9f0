# SPDX-License-Identifier: Apache-2.0
"""The two pages of a certificate and its annex with the uncertainty budgets."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.presentation.display import coefficient_unit, fixed, shown, with_uncertainty

from imu_workbench.report.certificate.budget import SOURCES
from imu_workbench.report.certificate.content import percent_at_most
from imu_workbench.report.figures.modelled import allan_deviation_figure
from imu_workbench.report.html.render import Row, Section
from imu_workbench.report.model_content import in_words

RESULTS_PER_ROW = 3
"""Results shared by the axes that stand in one row."""
ROWS_OF_A_PAGE = 12
"""Rows of results from which on they begin on the first page."""
DECISION_WORDS = {'pass': 'kept', 'fail': 'NOT KEPT', 'undecided': 'not decided'}


def certificate_section(found: Mapping[str, Any]) -> Section:
    """Return the certificate of one device: two pages."""
    device, results = found['device'], result_rows(found)
    values = {
        'found': found,
        'instruments': found['laboratory'],
        'recordings': [
            [
                row['name'],
                row['start'],
                f'{fixed(row["hours"], 1)} h',
                f'{shown(row["rate_hz"])} Hz',
                (row['up_axis'] or '–').replace('-', '−'),
                row['sha256'],
            ]
            for row in found['recordings']
        ],
        'results': results,
        'flowing': len(results) > ROWS_OF_A_PAGE,
        'errors': [
            [
                f'{row["sensor"].capitalize()} {row["axis"]}',
                shown(row['before']),
                shown(row['after']),
                shown(row['floor']),
                shown(row['ratio'], 2),
                row['unit'],
                detection_limit(found, row['sensor'], row['axis']),
            ]
            for row in found['errors']
        ],
        'decisions': decision_rows(found),
    }
    return Section(
        f'certificate-{device["name"]}',
        f'Calibration certificate: temperature error of {device["name"]}',
        'certificate.html',
        values,
        short=f'Certificate {device["name"]}',
    )


def budget_section(certificates: Mapping[str, Mapping[str, Any]]) -> Section | None:
    """Return the uncertainty budgets of every device."""
    if not certificates:
        return None
    devices = [
        {
            'name': name,
            'tables': budget_tables(found),
            'deviation': percent_at_most(found['monte_carlo_deviation']),
            'not_included': found['not_included'],
        }
        for name, found in certificates.items()
    ]
    title = 'Uncertainty budgets'
    return Section('budget', title, 'budget.html', {'devices': devices}, short='Budgets')


def allan_section(certificates: Mapping[str, Mapping[str, Any]]) -> Section | None:
    """Return the noise coefficients of every device."""
    devices = [
        {
            'name': name,
            'note': found['allan_rows'],
            'rows': [
                [
                    f'{row["sensor"].capitalize()}: {row["coefficient"]}',
                    *(interval(axis) for axis in row['axes']),
                    row['unit'],
                    datasheet(row['datasheet'], found['without_density']),
                ]
                for row in found['allan']
            ],
        }
        for name, found in certificates.items()
        if found['allan']
    ]
    if not devices:
        return None
    figures = {
        f'allan|{name}': allan_deviation_figure(found['allan_deviation'])
        for name, found in certificates.items()
        if found['allan_deviation']
    }
    values = {'devices': devices, 'drawn': figures}
    return Section('allan', 'Noise: Allan deviation', 'allan.html', values, figures, 'Noise')


def interval(axis: Sequence[float] | None) -> str:
    """Return a value with its interval.

    >>> interval([0.344, 0.341, 0.347]), interval([0.0, 0.0, 0.347]), interval(None)
    ('0.344 (0.341 … 0.347)', '< 0.347', '–')
    """
    if axis is None:
        return '–'
    value, low, high = map(shown, axis)
    return f'{value} ({low} … {high})' if axis[0] else f'< {high}'


def datasheet(value: float | None, silent: str) -> str:
    """Return a datasheet's value; `silent` names the chip whose datasheet has none.

    >>> datasheet(300.0, ''), datasheet(None, 'LSM9DS1'), datasheet(None, '')
    ('300', 'states none', 'not stated')
    """
    if value is not None:
        return shown(value)
    return 'states none' if silent else 'not stated'


def result_rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return rows of results with a cell per axis; of what axes share, three results a row."""
    rows: dict[tuple[Any, ...], dict[str, Any]] = {}
    shared: dict[tuple[str, ...], int] = {}
    for quantity in [*found['quantities'], *found['shapes']]:
        sensor, axis = quantity['sensor'], quantity['axis']
        unit, factor = _unit(sensor, quantity['unit'])
        name, label = result_name(quantity['coefficient'], shared=axis == 'all')
        key: tuple[Any, ...] = (sensor, name, unit)
        if axis == 'all':
            number = shared[key] = shared.get(key, -1) + 1
            key, axis = (*key, number // RESULTS_PER_ROW), 'xyz'[number % RESULTS_PER_ROW]
        row = rows.setdefault(
            key,
            {
                'sensor': sensor.capitalize(),
                'name': name,
                'unit': unit,
                'cells': {},
                'shared': quantity['axis'] == 'all',
            },
        )
        row['cells'][axis] = {'label': label, **result_cell(quantity, factor)}
    order = list(dict.fromkeys(q['sensor'].capitalize() for q in found['quantities']))
    return sorted(rows.values(), key=lambda row: order.index(row['sensor']))


def result_name(coefficient: str, *, shared: bool) -> tuple[str, str]:
    """Return the name of a row of results, and what tells a result that axes share from others.

    >>> result_name('scale_factor_temperature, s_x', shared=True)
    ('scale factor temperature', 's_x')
    >>> result_name('thermal_hysteresis: half_widths 2 of 3', shared=True)
    ('thermal hysteresis: half widths', '2 of 3')
    >>> result_name('thermal_hysteresis, 2 of 3', shared=False)
    ('thermal hysteresis, 2 of 3', '')
    """
    name = in_words(coefficient)
    told = re.fullmatch(r'(.*?)(?:, (.+)| (\d+ of \d+))', name) if shared else None
    return (told[1], told[2] or told[3]) if told else (name, '')


def result_cell(quantity: Mapping[str, Any], factor: float) -> dict[str, str]:
    """Return value ± U in another unit, with ν and k95; without U where a model has none."""
    if 'expanded' not in quantity:
        return {'value': shown(quantity['value'] * factor), 'detail': 'U not told'}
    by = quantity['coverage_factor']
    return {
        'value': with_uncertainty(quantity['value'] * factor, quantity['expanded'] * factor),
        'detail': f'ν {degrees(quantity["degrees"])}{f", k₉₅ {shown(by)}" if by > 2.05 else ""}',
    }


def degrees(value: float | None) -> str:
    """Return effective degrees of freedom: truncated, above a hundred they no longer matter.

    Below ten a tenth of one tells in k₉₅.

    >>> degrees(4.97), degrees(49.7), degrees(250.0), degrees(None)
    ('4.9', '49', '> 100', '∞')
    """
    if value is None or not math.isfinite(value):
        return '∞'
    if value < 10:
        return f'{math.floor(10.0 * value) / 10.0:.1f}'
    return '> 100' if value > 100 else str(int(value))


def detection_limit(found: Mapping[str, Any], sensor: str, axis: str) -> str:
    """Return the detection limit of an axis' slope with its unit."""
    for quantity in found['quantities']:
        if (quantity['sensor'], quantity['axis'], quantity['coefficient']) == (
            sensor, axis, 'slope',
        ):  # fmt: skip
            unit, factor = _unit(sensor, quantity['unit'])
            return f'{shown(quantity["detection_limit"] * factor, 2)} {unit}'
    return '–'


def decision_rows(found: Mapping[str, Any]) -> list[Row]:
    """Return a row per sensor and coefficient with limits: bounds, decision and w per axis."""
    rows: dict[tuple[str, str], Row] = {}
    for one in found['decisions']:
        unit, factor = _unit(one['sensor'], one['unit'])
        bounds = [
            shown(value * factor) if value is not None and math.isfinite(value) else 'none'
            for value in (one['lower'], one['upper'])
        ]
        row = rows.setdefault(
            (one['sensor'], one['coefficient']),
            [
                f'{one["sensor"].capitalize()}: {in_words(one["coefficient"])}',
                f'{bounds[0]} … {bounds[1]} {unit}',
            ],
        )
        width = one['deciding']
        by = '' if width is None else f', w {shown(width * factor)}'
        axis = '' if one['axis'] == 'all' else f'{one["axis"]}: '
        row.append(f'{axis}{DECISION_WORDS[one["decision"]]}{by}')
    return [[*row, *[''] * (5 - len(row))] for row in rows.values()]


BUDGET_WORDS = {'does not act': '–', 'none seen': '0'}
"""Text in a budget where a source gives no contribution; other words stay."""


def budget_tables(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return a table per sensor: a row per coefficient and axis, a column per source."""
    every = [*found['quantities'], *(s for s in found['shapes'] if 'rows' in s)]
    tables = []
    for sensor in dict.fromkeys(q['sensor'] for q in every):
        own = [q for q in every if q['sensor'] == sensor]
        sources = budget_sources(own)
        tables.append(
            {
                'sensor': sensor.capitalize(),
                'head': [['Coefficient', 'unit', *sources, 'u', 'ν', 'Monte Carlo']],
                'rows': [budget_row(q, sources) for q in own],
            }
        )
    return tables


def budget_sources(quantities: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the sources of some budgets in the order of `SOURCES`, each reference by its name."""
    named = [name for q in quantities for name in (*_by_source(q), *q['others'])]
    return [
        name
        for source in SOURCES
        for name in sorted({n for n in named if n.startswith(source)} - {'reference'}) or [source]
    ]


def budget_row(quantity: Mapping[str, Any], sources: Sequence[str]) -> Row:
    """Return what each source contributes to a coefficient, with its share of the variance."""
    unit, factor = _unit(quantity['sensor'], quantity['unit'])
    rows = _by_source(quantity)
    cells = [
        f'{shown(rows[s]["contribution"] * factor, 2)} ({fixed(rows[s]["share"], 0)} %)'
        if s in rows
        else BUDGET_WORDS.get(word := quantity['others'].get(s, 'does not act'), word)
        for s in sources
    ]
    axis = '' if quantity['axis'] == 'all' else f' {quantity["axis"]}'
    return [
        f'{in_words(quantity["coefficient"])}{axis}',
        unit,
        *cells,
        shown(quantity['combined'] * factor),
        degrees(quantity['degrees']),
        shown(quantity['monte_carlo'] * factor),
    ]


def _unit(sensor: str, unit: str) -> tuple[str, float]:
    found = coefficient_unit(sensor, unit)
    return found.unit, found.factor


def _by_source(quantity: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    return {row['source']: row for row in quantity['rows']}
