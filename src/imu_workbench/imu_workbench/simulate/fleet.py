# SPDX-License-Identifier: Apache-2.0
"""Campaigns of a population of simulated devices, streamed to bags; the truth stands beside them.

`DIR/lot=A/A00001/x`, `y`, `z`: one folder a device, one bag an orientation.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from imu_driver.simulation.hidden import hide_anything
from imu_driver.simulation.population import FleetDevice, draw_fleet_device, draw_lots
from imu_recording.user_error import UserError

from imu_recording import ImuRecording, write_bag
from imu_workbench.parallel import run_tasks
from imu_workbench.simulate.campaign import Logging, prepare_campaign, record_campaign
from imu_workbench.simulate.hidden_effect import TRUTH_FILE

FLEET = 'fleet'
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
        'kind': FLEET,
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
    return content if isinstance(content, dict) and content.get('kind') == FLEET else None
