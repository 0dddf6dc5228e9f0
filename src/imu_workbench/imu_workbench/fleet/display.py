# SPDX-License-Identifier: Apache-2.0
"""Results of a study in the units of display; study.json has SI units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from thermal_comp.presentation.display import coefficient_unit

PER_AXIS = ('mean', 'std', 'estimate_std', 'within_std')
BOUNDS = ('lower', 'upper', 'centre')


def displayed(entries: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return entries of a study with their coefficients, axes x, y, z, in the unit of display.

    >>> displayed([{'sensor': 'accelerometer', 'unit': 'm/s²/K', 'mean': [0.004, 0.0, -0.002]}])
    [{'sensor': 'accelerometer', 'unit': 'mm/s²/K', 'mean': [4.0, 0.0, -2.0]}]
    """
    return [_displayed(entry) for entry in entries]


def _displayed(entry: Mapping[str, Any]) -> dict[str, Any]:
    unit = coefficient_unit(entry['sensor'], entry['unit'])
    scaled = partial(_scaled, unit.factor)
    changed = {key: scaled(entry[key][:3]) for key in PER_AXIS if key in entry}
    bounds = {key: scaled([entry[key]])[0] for key in BOUNDS if key in entry}
    limits = {'limits': scaled(entry['limits'])} if 'limits' in entry else {}
    return {**entry, **changed, **bounds, **limits, 'unit': unit.unit}


def _scaled(factor: float, values: Sequence[float | None]) -> list[float | None]:
    return [None if value is None else factor * value for value in values]
