# SPDX-License-Identifier: Apache-2.0
"""The error after each step: measured, under each model version, with proposed effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from thermal_comp.comparison.compare import rms_of
from thermal_comp.model.values import ThermalModel
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS

from imu_workbench.report.analysis import Analysis, DeviceAnalysis
from imu_workbench.report.attitude import FULL, RAW, FilterAttitude
from imu_workbench.report.model_content import version_names


def error_steps_content(analysis: Analysis) -> dict[str, Any]:
    """Return per device and sensor the steps [display unit], and their effect in degrees."""
    found: dict[str, Any] = {}
    for device in analysis.devices:
        if device.comparison and device.model:
            sensors = {
                sensor: sensor_steps(device, sensor, analysis.diagnoses.get(device.name, {}))
                for sensor in SENSORS
                if sensor in device.comparison.sensors
            }
            runs = [r for r in analysis.runs if r.device == device.name and r.attitudes]
            found[device.name] = {
                'sensors': sensors,
                'versions': [RAW, *version_names(device.model)],
                'degrees': [
                    row | {'run': run.name, 'interpolated': run.interpolated}
                    for run in runs
                    for row in degrees(run.attitudes, len(device.model.history))
                ],
            }
    return found


def sensor_steps(device: DeviceAnalysis, sensor: str, diagnosis: Any) -> dict[str, Any]:
    """Return rms over the axes: measured, held out under each version, after proposed effects."""
    assert device.comparison and device.model  # noqa: S101, PT018 (the caller has looked)
    part = device.comparison.to_dict()['sensors'][sensor]
    factor = DISPLAY_UNITS[sensor].factor
    steps = [{'label': 'measured', 'error': rms_of(part['measured_rms']) * factor}]
    for older, comparison in zip(device.model.history, device.versions, strict=True):
        if sensor in comparison.sensors:
            error = comparison.to_dict()['sensors'][sensor]['held_out_rms']
            steps.append({'label': _effects(older, sensor), 'error': rms_of(error) * factor})
    steps.append({
        'label': _effects(device.model, sensor), 'error': rms_of(part['held_out_rms']) * factor,
    })  # fmt: skip
    proposed = [
        {'label': f'+ {step["added"].replace("_", " ")}', 'error': step['error_after'] * factor}
        for step in diagnosis.get('steps', ())
        if step['sensor'].split('+')[0] == sensor
    ]
    return {
        'unit': DISPLAY_UNITS[sensor].unit,
        'steps': steps,
        'proposed': proposed,
        'floor': rms_of(part['noise_floor']) * factor,
    }


def degrees(attitudes: Sequence[FilterAttitude], earlier: int) -> list[dict[str, Any]]:
    """Return σ of the rotation angle per filter: raw, under each version of the model [deg]."""
    spread = {
        (a.filter, a.data): a.statistics[0].get('std', {}).get('rotation') for a in attitudes
    }
    kinds = (RAW, *(f'version {number}' for number in range(1, earlier + 1)), FULL)
    return [
        {'filter': name, 'sigma': [spread.get((name, kind)) for kind in kinds]}
        for name in dict.fromkeys(a.filter for a in attitudes)
    ]


def degree_steps(found: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return per filter the steps in degrees, as rms over the runs, shaped like a sensor's."""
    steps = {}
    for name in dict.fromkeys(row['filter'] for row in found['degrees']):
        rows = [row['sigma'] for row in found['degrees'] if row['filter'] == name]
        if all(value is not None for row in rows for value in row):
            errors = np.sqrt(np.mean(np.square(rows), axis=0)).tolist()
            steps[name] = {
                'unit': '°',
                'steps': [
                    {'label': label, 'error': error}
                    for label, error in zip(found['versions'], errors, strict=True)
                ],
                'proposed': [],
                'floor': None,
            }
    return steps


def _effects(model: ThermalModel, sensor: str) -> str:
    for name, part in model.sensors.items():
        if name == sensor:
            return ' + '.join(e.name.replace('_', ' ') for e in part.effects) or 'levels only'
    return 'no model'
