# SPDX-License-Identifier: Apache-2.0
"""Sections of the page about the model: dependence, fit, comparison, coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.presentation.display import (
    DISPLAY_UNITS,
    SENSORS,
    SMALL_UNITS,
    coefficient_unit,
    scaled,
    shown,
    with_uncertainty,
)

from imu_workbench.report.figures.measured import PHASE_NAMES
from imu_workbench.report.figures.modelled import (
    dependence_figure,
    failure_figure,
    fit_figure,
    residual_figure,
)
from imu_workbench.report.html.measured import has_cycles
from imu_workbench.report.html.render import Row, Section, figure_of_paper
from imu_workbench.report.model_content import in_words

ERROR_COLUMNS = {
    'measured_rms': 'measured',
    'residual_rms': 'residual',
    'held_out_rms': 'held out',
    'noise_floor': 'noise floor',
}
"""Columns of the comparison."""


def dependence_section(content: Mapping[str, Any]) -> Section | None:
    """Return the section of Fig. 5."""
    found = content['dependence']
    sensors = _sensors_of(found)
    if not sensors:
        return None
    figures = {
        f'dependence|{sensor}': dependence_figure(
            {name: device[sensor] for name, device in found.items() if sensor in device},
            DISPLAY_UNITS[sensor].unit,
        )
        for sensor in sensors
    }
    slopes = [
        {
            'sensor': sensor,
            'unit': f'{SMALL_UNITS[sensor].unit}/K',
            'rows': slope_rows(content['slopes'], sensor),
        }
        for sensor in sensors
    ]
    values = {
        'sensors': sensors,
        'slopes': slopes,
        'pooled': pooled_rows(content['pooled']),
        'figure': figure_of_paper(content, 5),
        'chosen': worst_channel(content),
        'parts': 'cycles' if has_cycles(content) else 'parts of the run',
    }
    title = 'Dependence on temperature'
    return Section('dependence', title, 'dependence.html', values, figures)


def slope_rows(slopes: Sequence[Mapping[str, Any]], sensor: str) -> list[Row]:
    """Return one sensor's slopes per device, in its small unit per kelvin."""
    return [
        [
            row['device'],
            *(
                with_uncertainty(scaled(row['slope'][i], 1e3), scaled(row['uncertainty'][i], 1e3))
                for i in range(3)
            ),
            str(row['cycles']),
        ]
        for row in slopes
        if row['sensor'] == sensor
    ]


def pooled_rows(pooled: Mapping[str, Any]) -> list[Row]:
    """Return the rms of one model for all devices beside that of a model for each."""
    return [
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
            floor = noise_floor(content, run, sensor)
            for i, (axis, part) in enumerate(found['axes'].items()):
                figures[f'fit|{run}|{sensor}|{axis}'] = fit_figure(
                    part, found['unit'], floor[i] if floor else None
                )
    values = {
        'choices': {'Run': list(fits), 'Sensor': _sensors_of(fits), 'Axis': list('xyz')},
        'chosen': worst_channel(content),
        'gaussianity': gaussianity_rows(content),
        'figure': figure_of_paper(content, 6),
        'cycles': has_cycles(content),
    }
    return Section('fit', 'Fit and distributions', 'fit.html', values, figures)


def gaussianity_rows(content: Mapping[str, Any]) -> list[Row]:
    """Return χ² before and after compensation, per device, sensor and axis."""
    rows = []
    for device, comparison in content['comparison'].items():
        for sensor, found in comparison['sensors'].items():
            tests = found['gaussianity']
            for i, axis in enumerate('xyz'):
                before, after = (_test_cells(tests[when][i]) for when in ('before', 'after'))
                rows.append([f'{device} {sensor} {axis}', *before, *after])
    return rows


def _test_cells(test: Mapping[str, Any]) -> list[str]:
    return [
        f'{shown(test["chi_square"])} / {test["degrees"]}',
        shown(test['p_value'], 2),
        str(test['effective_n']),
    ]


def comparison_section(content: Mapping[str, Any]) -> Section | None:
    """Return model against measurement in numbers, over time, and where it fails."""
    if not content['comparison']:
        return None
    figures = {}
    for run, sensors in content['residuals'].items():
        for sensor, found in sensors.items():
            floor = noise_floor(content, run, sensor)
            figures[f'residual|{run}|{sensor}'] = residual_figure(
                found['axes'], found['unit'], floor
            )
            if found['where']:
                figures[f'where|{run}|{sensor}'] = failure_figure({'': found['where']})
    residuals = content['residuals']
    values = {
        'devices': [
            {
                'name': name,
                'held_out': found['held_out'],
                'rows': error_rows(found),
                'worst': worst_rows(found),
            }
            for name, found in content['comparison'].items()
        ],
        'columns': list(ERROR_COLUMNS.values()),
        'choices': {'Run': list(residuals), 'Sensor': _sensors_of(residuals)},
        'chosen': worst_channel(content),
        'added': '; '.join(
            a for c in content['certificates'].values() for a in c['added']
        ).replace('_', ' '),
        'has_maps': any(key.startswith('where|') for key in figures),
    }
    title = 'Model against measurement'
    return Section('comparison', title, 'comparison.html', values, figures)


def error_rows(found: Mapping[str, Any]) -> list[Row]:
    """Return the errors of one device's channels."""
    return [
        [
            f'{sensor.capitalize()} {axis}',
            *(
                shown(scaled(part[name][i], DISPLAY_UNITS[sensor].factor))
                for name in ERROR_COLUMNS
            ),
            DISPLAY_UNITS[sensor].unit,
            shown(part['r_squared'][i], 4),
            PHASE_NAMES.get(part['worst_phase'], '–'),
        ]
        for sensor, part in found['sensors'].items()
        for i, axis in enumerate('xyz')
    ]


def worst_rows(found: Mapping[str, Any]) -> list[Row]:
    """Return the groups of blocks in which one device's residual is largest."""
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
                    f'{sensor.capitalize()}: {group.replace("_", " ")}',
                    shown(where['ratio']),
                    *(shown(value * unit.factor) for value in where['rms']),
                    unit.unit,
                    str(where['blocks']),
                ]
            )
    return rows


def model_section(content: Mapping[str, Any]) -> Section | None:
    """Return the models' coefficients, versions and provenance."""
    if not content['models']:
        return None
    models = []
    for device, model in content['models'].items():
        low, high = model['temperature_range']
        models.append(
            {
                'device': device,
                'low': shown(low),
                'high': shown(high),
                'reference': shown(model['reference_temperature']),
                'rows': [term_row(term) for term in model['terms']],
                'shapes': shape_rows(model),
                'history': history_rows(model['history']),
            }
        )
    return Section('model', 'The certified model', 'model.html', {'models': models})


def term_row(term: Mapping[str, Any]) -> list[str | tuple[str, int]]:
    """Return a coefficient with its standard uncertainty per axis; once where axes share it."""
    unit = coefficient_unit(term['sensor'], term['unit'])
    cells = [
        with_uncertainty(value * unit.factor, sigma * unit.factor)
        for value, sigma in zip(term['value'], term['uncertainty'], strict=True)
    ]
    label = f'{term["sensor"].capitalize()}: {in_words(term["effect"])}'
    return [label, *([(cells[0], 3)] if term['shared'] else cells), unit.unit]


def shape_rows(model: Mapping[str, Any]) -> list[Row]:
    """Return every shape parameter with the standard uncertainty of the fit."""
    rows = []
    for shape in model['shapes']:
        several = isinstance(shape['value'], list)
        values, spread = (shape[key] if several else [shape[key]] for key in ('value', 'std'))
        spread = [*spread, *[None] * (len(values) - len(spread))]
        rows.append(
            [
                f'{shape["sensor"].capitalize()}: {shape["effect"].replace("_", " ")}',
                shape['parameter'].replace('_', ' '),
                ', '.join(map(with_uncertainty, values, spread)),
                shape['unit'],
            ]
        )
    return rows


def history_rows(versions: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Return the versions of a model, oldest first; nothing for a first version."""
    if len(versions) < 2:
        return []
    return [
        [f'{i}. {version["name"]}', version['effects'], str(version['bags']), version['package']]
        for i, version in enumerate(versions, 1)
    ]


def worst_channel(content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return run, sensor and axis whose error is most times its noise floor; () where unknown."""
    found = [
        (error / floor, device, sensor, axis)
        for device, comparison in content['comparison'].items()
        for sensor, part in comparison['sensors'].items()
        for error, floor, axis in zip(
            part['held_out_rms'], part['noise_floor'], 'xyz', strict=True
        )
        if error is not None and floor
    ]
    if not found:
        return ()
    _, device, sensor, axis = max(found)
    runs = [
        (max(ratio for row in where['ratio'] for ratio in row if ratio is not None), run)
        for run, parts in content['residuals'].items()
        if content['device_of_run'][run] == device
        and (where := parts.get(sensor, {}).get('where'))
    ]
    return (max(runs)[1], sensor, axis) if runs else (sensor, axis)


def noise_floor(content: Mapping[str, Any], run: str, sensor: str) -> list[float] | None:
    """Return the noise floor of a run's axes in the display unit, None where it is unknown."""
    device = content['device_of_run'].get(run)
    part = content['comparison'].get(device, {}).get('sensors', {}).get(sensor)
    if not part:
        return None
    factor = DISPLAY_UNITS[sensor].factor
    return [(scaled(value, factor) or 0.0) for value in part['noise_floor']]


def _sensors_of(found: Mapping[str, Mapping[str, Any]]) -> list[str]:
    return [sensor for sensor in SENSORS if any(sensor in part for part in found.values())]
