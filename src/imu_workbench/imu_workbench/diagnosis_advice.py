# SPDX-License-Identifier: Apache-2.0
"""What to do after a diagnosis, in a sentence for each finding."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

TOPICS = {
    'heater': 'chamber/heater',
    'compressor': 'chamber/compressor',
    'supply': 'imu/supply_voltage',
    'vibration': 'imu/vibration',
    'humidity': 'chamber/humidity',
}
"""Topic to log where a channel is missing."""
DEFECTS = {
    'saturation': 'choose a wider full scale or remove the magnet',
    'stuck_value': 'check bus and driver',
    'spikes': 'check bus and cable',
    'startup_transient': 'nothing: the first rows are cut',
    'orientation_flip': 'split the recording where the device was turned',
    'unit_mismatch': 'convert to SI units before',
    'impossible_statistic': 'check what was logged',
}


def advice(content: Mapping[str, Any]) -> list[str]:
    """Return what to do next, once each, in the order of the findings."""
    findings = content['findings']
    if not findings:
        return []
    return list(dict.fromkeys(line for f in findings for line in _of_finding(f)))


def _of_finding(finding: Mapping[str, Any]) -> Sequence[str]:
    kind, name, variable = finding['kind'], finding['name'], finding['depends_on']
    if kind == 'effect' and name == 'clock_temperature':
        return ['stamp the samples by the host, or scale the interval by temperature']
    if kind == 'effect':
        add = f'add {name}: python -m imu_workbench add {name} BAG… -o model.yaml'
        rivals = finding['ambiguous_with']
        if rivals:
            return [add, f'or separate them first: next-experiment {name} {rivals[0]}']
        return [add]
    if kind == 'unlogged':
        every = ', '.join(TOPICS.values())
        return [f'log {TOPICS.get(variable, every)} and record again']
    if kind == 'unexplained':
        return [f'look at the residual over {variable}: python -m imu_workbench compare BAG…']
    if kind == 'noise':
        return ['noise cannot be compensated: compare with another unit (--noise-reference MODEL)']
    return [f'{name}: {DEFECTS[name]}'] if name in DEFECTS else []
