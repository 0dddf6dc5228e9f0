# SPDX-License-Identifier: Apache-2.0
"""Curves from stretches at rest as JSON content, as text and as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS

from thermal_comp.data.conditions import Sensor
from thermal_comp.presentation.comparison import AXIS_COLOURS
from thermal_comp.presentation.display import (
    DISPLAY_UNITS,
    SMALL_UNITS,
    DisplayUnit,
    fixed,
    shown,
)

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture
    from thermal_comp.still.curves import StillCurves
    from thermal_comp.still.log import RestingLog

TABLE_STEP_K = 5.0
"""Step of the temperatures in the table [K]."""
BAND_SIGMA = 1.96
"""Half-width of a 95 % band in standard deviations."""
LEAST_AGEING_SIGMA = 2.0
"""Standard deviations from which ageing is named."""
DAYS_PER_YEAR = 365.25
CURVE_UNITS: dict[Sensor, DisplayUnit] = {
    'accelerometer': SMALL_UNITS['accelerometer'],
    'gyroscope': DISPLAY_UNITS['gyroscope'],
}
"""Units of the text and of the picture."""


def rest_content(logs: Sequence[RestingLog]) -> list[dict[str, Any]]:
    """Return what was found at rest in each log."""
    return [
        {
            'log': log.name,
            'started': _date(log.started),
            'duration_s': log.seconds,
            'rest_s': sum(end - start for start, end in log.rest),
            'stretches': [
                {
                    'run': run.name,
                    'from_s': start,
                    'to_s': end,
                    'temperature': [float(run.temperature.min()), float(run.temperature.max())],
                }
                for run, (start, end) in zip(log.runs, log.rest, strict=True)
            ],
            'note': log.note,
        }
        for log in logs
    ]


def curves_content(curves: StillCurves) -> dict[str, Any]:
    """Return curves with 95 % bands, time at each temperature, levels of logs, held-out errors."""
    grid = _grid(curves)
    return {
        'device': curves.model.device,
        'visited': [
            {'temperature': float(t), 'minutes': float(m)}
            for t, m in zip(curves.temperature, curves.minutes, strict=True)
        ],
        'not_visited': not_visited(curves),
        'base_temperature': curves.base,
        'odd_stretches': list(curves.odd),
        'logs': [
            {'log': log.name, 'age_days': DAYS_PER_YEAR * float(age)}
            for log, age in zip(curves.logs, curves.ages, strict=True)
        ],
        'sensors': {sensor: _sensor_content(curves, sensor, grid) for sensor in curves.sensors},
    }


def _sensor_content(curves: StillCurves, sensor: Sensor, grid: np.ndarray) -> dict[str, Any]:
    part = curves.sensors[sensor]
    value, std = curves.curve(sensor, grid)
    lags = [e.shape_parameters for e in curves.model.sensors[sensor].effects]
    return {
        'unit': SENSOR_UNITS[sensor],
        'temperature': grid,
        'curve': value,
        'band_95': BAND_SIGMA * std,
        'lag_s': next((float(s['time_constant']) for s in lags if 'time_constant' in s), None),
        'turn_on_std': part.turn_on,
        'level_of_logs': part.log_levels,
        'ageing_per_year': part.ageing[0],
        'ageing_std': part.ageing[1],
        'raw_rms': part.raw,
        'held_out_rms': part.held_out,
    }


def _grid(curves: StillCurves) -> np.ndarray:
    """Return the temperatures of the table within the range, and its ends."""
    low, high = float(curves.temperature[0]), float(curves.temperature[-1])
    inner = (
        np.arange(np.ceil(low / TABLE_STEP_K), np.floor(high / TABLE_STEP_K) + 0.5) * TABLE_STEP_K
    )
    return np.unique(np.concatenate([[low], inner, [high]]))


def not_visited(curves: StillCurves) -> list[tuple[float, float]]:
    """Return the first and last whole degree of every gap between visited temperatures."""
    empty = np.flatnonzero(curves.minutes == 0.0)
    pieces = np.split(empty, np.flatnonzero(np.diff(empty) > 1) + 1) if len(empty) else []
    return [(float(curves.temperature[p[0]]), float(curves.temperature[p[-1]])) for p in pieces]


def _date(seconds: float | None) -> str | None:
    """Return a Unix time [s] as a date, UTC."""
    if seconds is None:
        return None
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec='seconds')


def rest_text(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for each log: its length, time at rest, and temperatures there."""
    dated = any(row['started'] for row in rows)
    head = f'{"started":<12}' if dated else ''
    lines = [f'{"log":<28}{head}{"min":>8}{"at rest":>9}{"runs":>6}   die']
    for row in rows:
        found = row['stretches']
        warmth = [t for stretch in found for t in stretch['temperature']]
        said = f'{min(warmth):.1f} … {max(warmth):.1f} °C' if warmth else '–'
        note = f'  ({row["note"]})' if row['note'] else ''
        day = f'{(row["started"] or "–")[:10]:<12}' if dated else ''
        lines.append(
            f'{row["log"]:<28}{day}{row["duration_s"] / 60.0:>8.1f}{row["rest_s"] / 60.0:>9.1f}'
            f'{len(found):>6}   {said}{note}'
        )
    return lines


def curves_text(content: Mapping[str, Any]) -> list[str]:
    """Return the curves with their bands, held-out errors, levels and gaps, as lines."""
    lines: list[str] = []
    minutes = {row['temperature']: row['minutes'] for row in content['visited']}
    for sensor, part in content['sensors'].items():
        factor, unit = CURVE_UNITS[sensor].factor, CURVE_UNITS[sensor].unit
        lines += ['', f'{sensor} [{unit}], change since {content["base_temperature"]:g} °C, ±95 %']
        lines.append(f'{"°C":>8}{"min":>7}' + ''.join(f'{axis:>20}' for axis in 'xyz'))
        table = zip(part['temperature'], part['curve'], part['band_95'], strict=True)
        for t, value, band in table:
            near = sum(m for at, m in minutes.items() if abs(at - t) <= 0.5 * TABLE_STEP_K)
            pairs = zip(factor * value, factor * band, strict=True)
            cells = ''.join(f'{_with_band(v, b):>20}' for v, b in pairs)
            lines.append(f'{t:>8g}{near:>7.1f}{cells}')
        lines.append(_held_out_line(part, factor, unit))
        lines.append(_levels_line(part, factor, unit))
    gaps = [f'{a:g} … {b:g}' if b > a else f'{a:g}' for a, b in content['not_visited']]
    if gaps:
        lines += [
            '',
            f'never at rest at {", ".join(gaps)} °C: there the bands are all that is known',
        ]
    lines += [f'left out, its level is odd: {name}' for name in content['odd_stretches']]
    return lines


def _with_band(value: float, band: float) -> str:
    """Return a value and its band with as many decimals as the band has meaning."""
    if not band > 0.0:
        return '0'
    decimals = int(np.clip(1 - np.floor(np.log10(max(band, 1e-9))), 0, 6))
    return f'{fixed(value, decimals)} ± {fixed(band, decimals)}'


def _held_out_line(part: Mapping[str, Any], factor: float, unit: str) -> str:
    """Return the error on held-out logs before and after as a line."""
    raw, held = (
        factor * float(np.sqrt(np.mean(part[k] ** 2))) for k in ('raw_rms', 'held_out_rms')
    )
    lag = f'; it lags by {part["lag_s"]:.0f} s' if part['lag_s'] else ''
    if not np.isfinite(held):
        return f'one log: nothing to hold out{lag}'
    return (
        f'within stretches of logs it has not seen: {shown(raw)} {unit} before, {shown(held)} '
        f'after{lag}'
    )


def _levels_line(part: Mapping[str, Any], factor: float, unit: str) -> str:
    """Return how levels change by power-on and age, as a line."""
    if len(part['level_of_logs']) < 2:
        return 'one log: what a power-on changes is not known, nor ageing'
    turn = ', '.join(shown(factor * float(v), 2) for v in part['turn_on_std'])
    text = f'each power-on changes the level by {turn} {unit} (std)'
    ageing, std = np.asarray(part['ageing_per_year']), np.asarray(part['ageing_std'])
    if not np.isfinite(ageing).all():
        return f'{text}; ageing is not known: the logs have no dates a day apart'
    seen = [
        f'{axis} {_with_band(factor * a, BAND_SIGMA * factor * s)}'
        for axis, a, s in zip('xyz', ageing, std, strict=True)
        if abs(a) > LEAST_AGEING_SIGMA * s
    ]
    if seen:
        return f'{text}; it ages by {", ".join(seen)} {unit} a year'
    most = shown(BAND_SIGMA * factor * float(std.max()), 2)
    return f'{text}; no ageing is seen (it would be from {most} {unit} a year)'


def still_picture(curves: StillCurves) -> Picture:
    """Return a panel for each sensor: its curve with the 95 % band, and time at rest below."""
    from thermal_comp.presentation.picture import new_picture

    figure, panels = new_picture(len(curves.sensors) + 1, 3.0, stacked=True)
    figure.set_facecolor('white')
    course = np.linspace(curves.temperature[0], curves.temperature[-1], 200)
    for panel, sensor in zip(panels, curves.sensors, strict=False):
        factor, unit = CURVE_UNITS[sensor].factor, CURVE_UNITS[sensor].unit
        value, std = curves.curve(sensor, course)
        for axis, (label, colour) in enumerate(AXIS_COLOURS.items()):
            line, reach = factor * value[:, axis], BAND_SIGMA * factor * std[:, axis]
            panel.plot(course, line, color=colour, lw=1.5, label=label)
            panel.fill_between(course, line - reach, line + reach, color=colour, alpha=0.2, lw=0)
        panel.set(title=f'{curves.model.device}, {sensor}', ylabel=f'change [{unit}]')
    panels[0].legend(fontsize='small', ncols=3, loc='upper right')
    panels[-1].bar(curves.temperature, curves.minutes, width=0.9, color='0.6')
    panels[-1].set(ylabel='at rest [min]', xlabel='die temperature [°C]')
    return figure
