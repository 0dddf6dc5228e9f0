# SPDX-License-Identifier: Apache-2.0
"""A compensator's history in a file, so that a restart does not lose it."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from thermal_comp.compensation.stream import Compensator
from thermal_comp.data.binning import VibrationState
from thermal_comp.data.conditions import SENSORS
from thermal_comp.model.values import ThermalModel

SCHEMA = 1


def save_state(compensator: Compensator, path: str | os.PathLike[str]) -> None:
    """Write the history, whole or not at all."""
    document = {
        'schema': SCHEMA,
        'model': model_hash(compensator.model),
        'origin': compensator.origin,
        'newest': compensator.newest,
        'histories': compensator.histories,
        'vibration': compensator.vibration,
    }
    target = Path(path)
    unfinished = target.with_name(f'.{target.name}.unfinished')
    unfinished.write_text(json.dumps(document, default=_plain), 'utf-8')
    unfinished.replace(target)


def restore_state(compensator: Compensator, path: str | os.PathLike[str]) -> str:
    """Give a new compensator the history of an earlier one; return the reason where that fails."""
    target = Path(path)
    if not target.is_file():
        return f'{target} does not exist yet'
    try:
        document = json.loads(target.read_text('utf-8'))
        if document['schema'] != SCHEMA or document['model'] != model_hash(compensator.model):
            return f'{target} belongs to another model'
        histories = {
            sensor: _tuples(document['histories'][sensor])
            for sensor in SENSORS
            if sensor in document['histories']
        }
        origin, newest = int(document['origin']), int(document['newest'])
        vibration = VibrationState._make(_tuples(document['vibration']))
    except (ValueError, KeyError, TypeError, OSError) as error:
        return f'{target} cannot be read: {error}'
    if newest < 0:
        return f'{target} was written before the first sample'
    compensator.resume(origin, newest, histories, vibration)
    return ''


def model_hash(model: ThermalModel) -> str:
    """Return a hash of what the model computes."""
    sensors = json.dumps(model.to_dict()['sensors'], sort_keys=True)
    return hashlib.sha256(sensors.encode()).hexdigest()


def _plain(value: Any) -> Any:
    """Return a numpy number or array as JSON knows it."""
    return value.tolist()


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value
