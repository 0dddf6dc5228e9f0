# SPDX-License-Identifier: Apache-2.0
"""How the error falls, step by step: measured, every version of the model, what is proposed."""

from __future__ import annotations

from typing import Any

import numpy as np
from thermal_comp.model import ThermalModel

from imu_workbench.display import DISPLAY_UNITS, SENSORS
from imu_workbench.study import StudiedDevice, Study


def staircase_content(study: Study) -> dict[str, Any]:
    """Return per device and sensor the steps [display unit], and their effect in degrees."""
    found: dict[str, Any] = {}
    for device in study.devices:
        if device.comparison and device.model:
            sensors = {
                sensor: sensor_steps(device, sensor, study.diagnoses.get(device.name, {}))
                for sensor in SENSORS
                if sensor in device.comparison.sensors
            }
            found[device.name] = {'sensors': sensors, 'degrees': degrees(study, device.name)}
    return found


def sensor_steps(device: StudiedDevice, sensor: str, diagnosis: Any) -> dict[str, Any]:
    """Return rms over the axes: measured, held out under each version, after proposed effects."""
    assert device.comparison and device.model  # noqa: S101, PT018 (the caller has looked)
    part = device.comparison.content()['sensors'][sensor]
    factor = DISPLAY_UNITS[sensor].factor
    steps = [{'label': 'measured', 'error': _rms(part['measured_rms']) * factor}]
    for older, comparison in zip(device.model.history, device.versions, strict=True):
        if sensor in comparison.sensors:
            error = comparison.content()['sensors'][sensor]['held_out_rms']
            steps.append({'label': _effects(older, sensor), 'error': _rms(error) * factor})
    steps.append({
        'label': _effects(device.model, sensor), 'error': _rms(part['held_out_rms']) * factor,
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
        'floor': _rms(part['noise_floor']) * factor,
    }


def degrees(study: Study, device: str) -> list[dict[str, Any]]:
    """Return σ of the rotation angle per run and filter, raw and under the model [deg]."""
    rows = []
    for run in study.runs:
        if run.device != device:
            continue
        spread = {
            (a.filter, a.data): a.statistics[0].get('std', {}).get('rotation')
            for a in run.attitudes
        }
        rows += [
            {
                'run': run.name,
                'filter': name,
                'interpolated': run.interpolated,
                'raw': spread[name, 'raw'],
                'compensated': spread[name, 'compensated'],
            }
            for name in dict.fromkeys(a.filter for a in run.attitudes)
        ]
    return rows


def _effects(model: ThermalModel, sensor: str) -> str:
    for name, part in model.sensors.items():
        if name == sensor:
            return ' + '.join(e.name.replace('_', ' ') for e in part.effects) or 'levels only'
    return 'no model'


def _rms(per_axis: Any) -> float:
    return float(np.sqrt(np.nanmean(np.square(per_axis))))
