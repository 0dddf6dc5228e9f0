# SPDX-License-Identifier: Apache-2.0
"""A thermal model as text, table and picture."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY

from thermal_comp.data.conditions import Conditions
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown, with_uncertainty
from thermal_comp.presentation.html_table import html_table

if TYPE_CHECKING:
    from thermal_comp.presentation.picture import Picture

RAMP_RATE = 2.0 / 60.0
"""Temperature rate of the sweep that is drawn [K/s]: the paper's ramps."""
DRAWN_FIELD_T = 50e-6
"""Magnetic field that is drawn [T]."""


def text(document: Mapping[str, Any]) -> str:
    """Return the model (the document of its file) as lines: effects, their rms, their shapes."""
    lines = [_title(document)]
    for sensor, row in _rows(document):
        name, shape, *shares, unit = row
        error = ' '.join(f'{share:>9}' for share in shares)
        lines.append(f'  {sensor:<14}{name:<28}{error} {unit}  {shape}'.rstrip())
    return '\n'.join(lines)


def table(document: Mapping[str, Any]) -> str:
    """Return the model as an HTML table."""
    head = ['sensor', 'effect', 'shape', 'rms x', 'y', 'z', 'unit']
    rows = [[sensor, *row] for sensor, row in _rows(document)]
    return html_table(_title(document), head, rows, document['provenance']['notes'])


def picture(model: Any) -> Picture:
    """Return the modelled error through a sweep over the fitted temperatures, a panel a sensor.

    The device rests, z up; effects whose channels are not known here contribute nothing.
    """
    from thermal_comp.presentation.picture import new_picture

    sensors = [s for s in SENSORS if s in model.sensors]
    figure, panels = new_picture(len(sensors))
    for panel, sensor in zip(panels, sensors, strict=True):
        unit, part = DISPLAY_UNITS[sensor], model.sensors[sensor]
        conditions = _sweep(part.temperature_range, model.reference_temperature).of(sensor)
        error = unit.of(part.modelled_error(conditions)[0])
        for i, axis in enumerate('xyz'):
            panel.plot(conditions.temperature, error[:, i], lw=1.2, label=axis)
        panel.set(title=sensor, xlabel='die temperature [°C]', ylabel=f'error [{unit.unit}]')
    panels[0].legend(fontsize='small')
    return figure


def _title(document: Mapping[str, Any]) -> str:
    sources = document['provenance']['sources']
    fitted = f', fitted to {len(sources)} runs ({", ".join(sources)})' if sources else ''
    name = document['device'] or 'a device that is not named'
    return f'thermal model of {name}{fitted}: rms of each effect'


def _rows(document: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Return sensor, and name, shape, rms of x, y, z and unit of each effect."""
    rows: list[tuple[str, list[str]]] = []
    for sensor in (s for s in SENSORS if s in document['sensors']):
        unit = DISPLAY_UNITS[sensor]
        for effect in document['sensors'][sensor]['effects']:
            shares = [shown(value * unit.factor) for value in effect['rms']]
            rows.append((sensor, [effect['name'], _shape(effect['shape']), *shares, unit.unit]))
    return rows


def _shape(shape: Mapping[str, Mapping[str, Any]]) -> str:
    told = []
    for name, given in shape.items():
        values = given['value'] if isinstance(given['value'], list) else [given['value']]
        spread = [*given.get('std', ()), *[None] * len(values)]
        pairs = zip(values, spread, strict=False)
        numbers = ', '.join(with_uncertainty(value, std) for value, std in pairs)
        told.append(f'{name.replace("_", " ")} {numbers} {given["unit"]}')
    return '; '.join(told)


def _sweep(span: tuple[float, float], reference: float) -> Conditions:
    """Return a resting device taken from the reference through a span of temperatures and back."""
    low, high = (float(np.clip(t, -40.0, 125.0)) for t in span)
    corners = np.array([reference, low, high, low, high, reference])
    durations = np.abs(np.diff(corners)) / RAMP_RATE
    time = np.arange(0.0, durations.sum(), 10.0)
    rows = (len(time), 3)
    return Conditions(
        time=time,
        temperature=np.interp(time, np.r_[0.0, np.cumsum(durations)], corners),
        specific_force=np.broadcast_to([0.0, 0.0, STANDARD_GRAVITY], rows),
        angular_velocity=np.zeros(rows),
        magnetic_field=np.broadcast_to([DRAWN_FIELD_T, 0.0, 0.0], rows),
        reference_temperature=reference,
    )
