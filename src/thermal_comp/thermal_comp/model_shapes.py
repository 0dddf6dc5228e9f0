# SPDX-License-Identifier: Apache-2.0
"""The shape parameters of a model, as plain values with standard deviations and units."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from thermal_comp.model import ThermalModel


def fitted_shapes(model: ThermalModel) -> list[dict[str, Any]]:
    """Return sensor, effect, parameter, value, std and unit of each; several values are lists.

    Counts (unit '1'), which are part of the form and not fitted, are left out.
    """
    rows: list[dict[str, Any]] = []
    for sensor, part in model.sensors.items():
        for effect in part.effects:
            for item in fields(effect):
                unit = item.metadata.get('unit', '1')
                if unit == '1':
                    continue
                value = getattr(effect, item.name)
                several = isinstance(value, tuple)
                spread = part.shape_std.get(f'{effect.name}.{item.name}', ())
                rows.append(
                    {
                        'sensor': sensor,
                        'effect': effect.name,
                        'parameter': item.name,
                        'value': list(value) if several else value,
                        'std': list(spread) if several else next(iter(spread), None),
                        'unit': unit,
                    }
                )
    return rows
