# SPDX-License-Identifier: Apache-2.0
"""Sections of the page about the model: dependence, fit, comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown, with_uncertainty

from imu_workbench.report.figures.measured import PHASE_NAMES
from imu_workbench.report.figures.modelled import (
    dependence_figure,
    failure_figure,
    fit_figure,
    residual_figure,
)
from imu_workbench.report.html.render import Choice, Section, group_html, table_html

ERRORS = {
    'measured_rms': 'measured',
    'residual_rms': 'residual',
    'held_out_rms': 'held out',
    'noise_floor': 'noise floor',
}
"""Columns of the comparison."""


def dependence_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of Fig. 5."""
    found = content['dependence']
    sensors = [s for s in SENSORS if any(s in device for device in found.values())]
    if not sensors:
        return None
    figures = {
        f'dependence|{sensor}': dependence_figure(
            {name: device[sensor] for name, device in found.items() if sensor in device},
            DISPLAY_UNITS[sensor].unit,
        )
        for sensor in sensors
    }
    caption = (
        'Fig. 5. Error against die temperature: mean and standard deviation of 20 s means in bins '
        'of 2 K over all runs of a device, and its model (line).'
    )
    group = group_html(
        'dependence', [Choice('Sensor', sensors)], caption, 'Error against die temperature',
        parts=''.join(slopes_html(content['slopes'], sensor) for sensor in sensors),
    )  # fmt: skip
    pooled = '' if not content['pooled'] else pooled_html(content['pooled'])
    return Section('dependence', 'Dependence on temperature', group + pooled, figures)


def slopes_html(slopes: Sequence[Mapping[str, Any]], sensor: str) -> str:
    """Return the table of one sensor's slopes."""
    rows = [
        [
            escape(row['device']),
            *(
                with_uncertainty(
                    _thousandfold(row['slope'][i]), _thousandfold(row['uncertainty'][i])
                )
                for i in range(3)
            ),
            str(row['cycles']),
        ]
        for row in slopes
        if row['sensor'] == sensor
    ]
    unit = f'10⁻³ {DISPLAY_UNITS[sensor].unit}/K'
    head = [['Device', *(f'{axis} [{unit}]' for axis in 'xyz'), 'cycles']]
    caption = f'Slope of the {sensor}: mean of the cycles ± its standard uncertainty'
    return table_html(head, rows, caption=caption, key=sensor) if rows else ''


def _thousandfold(value: float | None) -> float | None:
    return None if value is None else 1e3 * value


def pooled_html(pooled: Mapping[str, Any]) -> str:
    """Return the paper's argument against one model for all devices, as a table."""
    rows = [
        [
            f'{sensor.capitalize()} {axis}',
            *(shown(_worst(test[kind], i) * unit.factor) for kind in ('own_rms', 'pooled_rms')),
            unit.unit,
            'yes' if test['opposite_signs'][i] else 'no',
            shown(test['normalised_difference'][i]),
        ]
        for sensor, test in pooled.items()
        for unit in (DISPLAY_UNITS[sensor],)
        for i, axis in enumerate('xyz')
    ]
    head = [[
        'Channel', 'own models', 'one for all', 'unit', 'opposite signs', 'Eₙ',
    ]]  # fmt: skip
    caption = (
        'Pooling over devices: rms of 20 s means of the worst device, Eₙ the largest normalised '
        'difference of two slopes (compatible: at most 1)'
    )
    return table_html(head, rows, caption=caption)


def _worst(rms: Sequence[Sequence[float]], axis: int) -> float:
    return max(row[axis] for row in rms)


def fit_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of Fig. 6."""
    fits = content['fits']
    if not fits:
        return None
    figures = {}
    for run, sensors in fits.items():
        for sensor, found in sensors.items():
            for axis, part in found['axes'].items():
                floor = _floor(content, run, sensor)
                figures[f'fit|{run}|{sensor}|{axis}'] = fit_figure(
                    part, found['unit'], floor[int('xyz'.index(axis))] if floor else None
                )
    sensors = [s for s in SENSORS if any(s in found for found in fits.values())]
    caption = (
        'Fig. 6. Left: 20 s means against die temperature and the model. Right: their '
        'distribution before and after compensation. Before, the two modes sit at the cold and '
        'the hot dwell; after, the dwells lie on top of each other where the model is complete.'
    )
    choices = [Choice('Run', list(fits)), Choice('Sensor', sensors), Choice('Axis', list('xyz'))]
    group = group_html('fit', choices, caption, 'Model and distributions')
    return Section('fit', 'Fit and distributions', group + gaussianity_html(content), figures)


def gaussianity_html(content: Mapping[str, Any]) -> str:
    """Return χ² before and after per device, sensor and axis."""
    rows = []
    for device, comparison in content['comparison'].items():
        for sensor, found in comparison['sensors'].items():
            tests = found['gaussianity']
            for i, axis in enumerate('xyz'):
                cells = [_test_cells(tests[when][i]) for when in ('before', 'after')]
                rows.append([f'{escape(device)} {sensor} {axis}', *cells[0], *cells[1]])
    if not rows:
        return ''
    head = [
        ['', 'before|3', 'after|3'],
        ['Channel', *(['χ² / degrees of freedom', 'p', 'effective n'] * 2)],
    ]
    table = table_html(head, rows, caption='Is the distribution Gaussian? (χ² test)')
    return f'<details><summary>χ² test of every channel</summary>{table}</details>'


def _test_cells(test: Mapping[str, Any]) -> list[str]:
    return [
        f'{shown(test["chi_square"])} / {test["degrees"]}',
        shown(test['p_value'], 2),
        str(test['effective_n']),
    ]


def comparison_section(content: Mapping[str, Any]) -> Section | None:
    """Return model against measurement in numbers, over time, and where it fails."""
    comparison = content['comparison']
    if not comparison:
        return None
    body = (
        '<p>Rms of 20 s means. <em>Held out</em>: cycles (or blocks) the fit has not seen. '
        '<em>Noise floor</em>: what the fitted noise alone would leave; a residual above it is '
        'temperature error the model does not know.</p>'
    )
    body += ''.join(comparison_html(name, found) for name, found in comparison.items())
    figures = {}
    for run, sensors in content['residuals'].items():
        for sensor, found in sensors.items():
            floor = _floor(content, run, sensor)
            figures[f'residual|{run}|{sensor}'] = residual_figure(
                found['axes'], found['unit'], floor
            )
            if found['where']:
                figures[f'where|{run}|{sensor}'] = failure_figure({'': found['where']})
    runs = list(content['residuals'])
    sensors = [s for s in SENSORS if any(s in found for found in content['residuals'].values())]
    choices = [Choice('Run', runs), Choice('Sensor', sensors)]
    body += '<h3>Over time</h3>' + group_html(
        'residual',
        choices,
        'Measured and modelled error, and below each the residual with the band of ± 2 σ of the '
        'noise floor.',
        'Measured, modelled and residual error over time',
    )
    if any(key.startswith('where|') for key in figures):
        body += '<h3>Where it fails</h3>' + group_html(
            'where', choices,
            'Residual over noise floor (rms over the three axes) by phase and cycle. The colours '
            'mean the same in every map: the calm end of the scale is noise alone.',
            'Residual by phase and cycle',
        )  # fmt: skip
    return Section('comparison', 'Model against measurement', body, figures)


def comparison_html(device: str, found: Mapping[str, Any]) -> str:
    """Return one device's comparison as a table."""
    rows = []
    for sensor, part in found['sensors'].items():
        factor, unit = DISPLAY_UNITS[sensor].factor, DISPLAY_UNITS[sensor].unit
        for i, axis in enumerate('xyz'):
            rows.append(
                [
                    f'{sensor.capitalize()} {axis}',
                    *(shown(_scaled(part[name][i], factor)) for name in ERRORS),
                    unit,
                    shown(part['r_squared'][i], 4),
                    escape(PHASE_NAMES.get(part['worst_phase'], '–')),
                ]
            )
    head = [['Channel', *ERRORS.values(), 'unit', 'R²', 'worst phase']]
    caption = f'{escape(device)}, held out: {escape(found["held_out"])}'
    return table_html(head, rows, caption=caption) + worst_html(device, found)


def worst_html(device: str, found: Mapping[str, Any]) -> str:
    """Return the groups of blocks in which the residual is largest."""
    rows = []
    for sensor, part in found['sensors'].items():
        unit = DISPLAY_UNITS[sensor]
        for where in part['where'][:6]:
            group = ', '.join(
                f'{key} {value}'
                if key in ('cycle', 'orientation')
                else PHASE_NAMES.get(value, str(value))
                for key, value in where.items()
                if key not in ('ratio', 'rms', 'blocks')
            )
            rows.append(
                [
                    f'{sensor.capitalize()}: {escape(group.replace("_", " "))}',
                    shown(where['ratio']),
                    *(shown(value * unit.factor) for value in where['rms']),
                    unit.unit,
                    str(where['blocks']),
                ]
            )
    head = [['Group', 'times the noise floor', 'x', 'y', 'z', 'unit', 'blocks']]
    table = table_html(head, rows, caption=f'{escape(device)}: largest residuals')
    return f'<details><summary>Where it fails, in numbers</summary>{table}</details>'


def model_section(content: Mapping[str, Any]) -> Section | None:
    """Return the models' coefficients, versions and provenance."""
    if not content['models']:
        return None
    body = ''
    for device, model in content['models'].items():
        rows = [
            [
                f'{term["sensor"].capitalize()}: {escape(term["effect"].replace("_", " "))}',
                *(with_uncertainty(term['value'][i], term['uncertainty'][i]) for i in range(3)),
                escape(term['unit']),
            ]
            for term in model['terms']
        ]
        head = [['Term', 'x', 'y', 'z', 'unit']]
        caption = (
            f'{escape(device)}: valid {shown(model["temperature_range"][0])} … '
            f'{shown(model["temperature_range"][1])} °C, '
            f'referred to {shown(model["reference_temperature"])} °C'
        )
        body += table_html(head, rows, caption=caption)
        body += history_html(device, model['history'])
    return Section('model', 'The models', body)


def history_html(device: str, versions: Sequence[Mapping[str, Any]]) -> str:
    """Return the versions of a model, oldest first; '' for a first version."""
    if len(versions) < 2:
        return ''
    rows = [
        [
            f'{number}. {escape(version["name"])}',
            escape(version['effects']),
            str(version['bags']),
            escape(version['package']),
        ]
        for number, version in enumerate(versions, 1)
    ]
    head = [['Version', 'effects', 'runs', 'package']]
    caption = f'{escape(device)}: history of the model; its errors stand in the staircase above'
    return table_html(head, rows, caption=caption, text_columns=(1,))


def _floor(content: Mapping[str, Any], run: str, sensor: str) -> list[float] | None:
    device = content['device_of_run'].get(run)
    part = content['comparison'].get(device, {}).get('sensors', {}).get(sensor)
    if not part:
        return None
    factor = DISPLAY_UNITS[sensor].factor
    return [(_scaled(value, factor) or 0.0) for value in part['noise_floor']]


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor
