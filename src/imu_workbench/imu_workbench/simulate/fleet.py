# SPDX-License-Identifier: Apache-2.0
"""A fleet of simulated devices: its bags, the truth beside them, the score of a study by it.

`DIR/lot=A/A00001/x`, `y`, `z`: one folder a device, one bag an orientation.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from imu_driver.simulation.hidden import hide_anything
from imu_driver.simulation.population import FleetDevice, draw_fleet_device, draw_lots
from imu_recording.recording import SENSOR_FIELDS
from imu_recording.user_error import UserError

from imu_recording import ImuRecording, write_bag
from imu_workbench.parallel import run_tasks
from imu_workbench.simulate.campaign import Logging, prepare_campaign, record_campaign
from imu_workbench.simulate.hidden_effect import TRUTH_FILE

FLEET_KIND = 'fleet'
"""`kind` in the truth file of a fleet."""


@dataclass(frozen=True)
class FleetPlan:
    """How many devices of how many lots run which profile."""

    profile: str
    devices: int
    lots: int
    seed: int
    logging: Logging

    def device(self, number: int) -> FleetDevice:
        """Return one device of the population, 0 … devices − 1."""
        lots = draw_lots(self.lots, self.seed)
        return draw_fleet_device(lots, number, self.devices, self.seed)


def simulate_fleet_device(plan: FleetPlan, number: int) -> list[ImuRecording]:
    """Return the campaign of one device; the devices of a lot share the chamber's runs."""
    device = plan.device(number)
    runs = prepare_campaign(
        plan.profile,
        device.parameters,
        seed=plan.seed + number,
        chamber_seed=plan.seed + ord(device.lot),
    )
    for effect in device.effects:
        hidden = hide_anything(
            runs,
            effect.name,
            magnitude=effect.magnitude,
            seed=effect.seed,
            sensor=effect.sensor,
        )
        runs = hidden.runs
    return record_campaign(runs, plan.logging)


@dataclass(frozen=True)
class _DeviceTask:
    plan: FleetPlan
    number: int
    folder: Path
    size: float = 1.0

    @property
    def label(self) -> str:
        return f'simulated device {self.number + 1}'

    def run(self) -> dict[str, Any]:
        device = self.plan.device(self.number)
        home = self.folder / f'lot={device.lot}' / device.parameters.name
        for recording in simulate_fleet_device(self.plan, self.number):
            write_bag(recording, home / recording.up_axis.lstrip('+'))
        return {
            'lot': device.lot,
            'slopes': device.slopes.tolist(),
            'effects': [asdict(effect) for effect in device.effects],
            'outlier': device.outlier,
            'name': device.parameters.name,
        }


def write_fleet(plan: FleetPlan, folder: Path, workers: int) -> int:
    """Write the bags of every device and, last, the truth; return the number of bags."""
    truth = folder / TRUTH_FILE
    if folder.exists() and any(folder.iterdir()):
        raise UserError(f'{folder} exists already and is not empty: choose another -o')
    folder.mkdir(parents=True, exist_ok=True)
    tasks = [_DeviceTask(plan, number, folder) for number in range(plan.devices)]
    devices = {found.pop('name'): found for found in run_tasks(tasks, workers)}
    content = {
        'schema': 1,
        'kind': FLEET_KIND,
        'profile': plan.profile,
        'seed': plan.seed,
        'lots': {
            lot.name: {
                'mean': lot.mean.tolist(),
                'covariance': lot.covariance.tolist(),
                'effects': [asdict(effect) for effect in lot.effects],
            }
            for lot in draw_lots(plan.lots, plan.seed)
        },
        'devices': devices,
    }
    truth.write_text(json.dumps(content, ensure_ascii=False) + '\n', 'utf-8')
    return 3 * plan.devices


def fleet_truth(folder: Path) -> Mapping[str, Any] | None:
    """Return the truth of a simulated fleet; None where the folder holds none."""
    file = folder / TRUTH_FILE
    if not file.is_file():
        return None
    try:
        content: Any = json.loads(file.read_text('utf-8'))
    except ValueError as error:
        raise UserError(f'{file}: not what `simulate` writes ({error})') from None
    return content if isinstance(content, dict) and content.get('kind') == FLEET_KIND else None


def score_fleet(found: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
    """Return outliers found, false alarms, errors of the lots' means, prevalence."""
    devices: Mapping[str, Any] = truth['devices']
    outliers = {name for name, one in devices.items() if one['outlier']}
    odd = {one['device'] for one in found['odd']}
    ordinary = len(devices) - len(outliers)
    errors = [
        (np.array(one['mean']) - np.array(truth['lots'][one['lot']]['mean'])[_axes(one)])
        / np.sqrt(np.diag(truth['lots'][one['lot']]['covariance']))[_axes(one)]
        for one in found['populations']
        if one['lot'] in truth['lots']
    ]
    shares = []
    for lot, drawn in truth['lots'].items():
        own = [one for one in devices.values() if one['lot'] == lot]
        for effect in drawn['effects']:
            has = sum(_has(one, effect) for one in own) / max(1, len(own))
            named = [
                one['share']
                for one in found['prevalence']
                if one['named']
                and (one['lot'], one['sensor'], one['effect'])
                == (lot, effect['sensor'], effect['name'])
            ]
            shares.append(
                {
                    'lot': lot,
                    'effect': effect['name'],
                    'sensor': effect['sensor'],
                    'true': has,
                    'found': named[0] if named else 0.0,
                }
            )
    score: dict[str, Any] = {
        'outliers': len(outliers),
        'outliers_found': len(outliers & odd),
        'false_alarms': len(odd - outliers) / max(1, ordinary),
        'worst_mean_error': float(np.abs(errors).max()) if errors else float('nan'),
        'prevalence': shares,
    }
    hits = f'{score["outliers_found"]} of {len(outliers)} outliers'
    score['lines'] = [
        f'found {hits}, false alarms {100 * score["false_alarms"]:.1f} % of {ordinary}',
        f"lots' means off by at most {score['worst_mean_error']:.2f} σ of the lot",
        *(
            f'lot {one["lot"]}: {one["effect"]} in {one["sensor"]}: '
            f'true {100 * one["true"]:.0f} %, found {100 * one["found"]:.0f} %'
            for one in shares
        ),
    ]
    return score


def _axes(one: Mapping[str, Any]) -> slice:
    first = 3 * list(SENSOR_FIELDS).index(one['sensor'])
    return slice(first, first + 3)


def _has(device: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    return any(
        (own['name'], own['sensor']) == (effect['name'], effect['sensor'])
        for own in device['effects']
    )
