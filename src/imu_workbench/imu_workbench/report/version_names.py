# SPDX-License-Identifier: Apache-2.0
"""What the versions of a model are called: by the effects each of them brings."""

from __future__ import annotations

from thermal_comp.model.values import ThermalModel


def version_names(model: ThermalModel) -> list[str]:
    """Return a name for every version, oldest first: `bias temperature`, `+ thermal lag` …"""
    names: list[str] = []
    before: list[str] = []
    for version in (*model.history, model):
        effects = effects_of(version)
        added = [effect for effect in effects if effect not in before]
        gone = [effect for effect in before if effect not in effects]
        parts = [*added, *(f'without {effect}' for effect in gone)]
        text = ' + '.join(parts) or ('refitted' if names else 'levels only')
        names.append(f'+ {text}' if names and added else text)
        before = effects
    return names


def effects_of(model: ThermalModel) -> list[str]:
    """Return the effects of a version over all sensors, each once."""
    found = (effect.name for part in model.sensors.values() for effect in part.effects)
    return [name.replace('_', ' ') for name in dict.fromkeys(found)]
