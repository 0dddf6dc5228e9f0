# SPDX-License-Identifier: Apache-2.0
"""What a laboratory states once about itself, its instruments and the place: laboratory.yaml."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from imu_recording.recording import STANDARD_GRAVITY

from imu_workbench.report.checked_yaml import read_checked

NOT_STATED = 'not stated'
"""Text in place of a missing statement; no value is ever assumed instead."""
EARTH_GRAVITY_HALF_WIDTH = 0.027
"""Gravity at sea level lies between 9.780 and 9.833 m/s² (WGS 84): so far from 9.80665 at most."""
FIELD_UNITS = {'nT': 1e-9, 'µT': 1e-6}


@dataclass(frozen=True)
class Laboratory:
    """The statements of a laboratory; what was not given is None or 'not stated'."""

    content: Mapping[str, Any] = field(default_factory=dict)
    """As in the file (`schemas/laboratory.json`)."""

    def text(self, *keys: str) -> str:
        """Return a statement by its place in the file.

        >>> Laboratory({'chamber': {'type': 'VT 4002'}}).text('chamber', 'type')
        'VT 4002'
        >>> Laboratory().text('operator')
        'not stated'
        """
        value: Any = self.content
        for key in keys:
            value = value.get(key) if isinstance(value, Mapping) else None
        return NOT_STATED if value is None else str(value)

    def instrument(self, name: str) -> dict[str, str]:
        """Return the statements about `chamber` or `thermometer`."""
        known: Mapping[str, Any] = self.content.get(name, {})
        parts = [known[k] for k in ('manufacturer', 'type') if k in known]
        due = f', due {known["due"]}' if 'due' in known else ''
        standard = self.standard_uncertainty(name)
        uncertainty = NOT_STATED
        if standard is not None:
            k = known.get('coverage_factor', 2.0)
            uncertainty = f'{known["expanded_uncertainty"]:g} K (k = {k:g})'
        return {
            'type': ' '.join(parts) or NOT_STATED,
            'serial': self.text(name, 'serial'),
            'certificate': self.text(name, 'certificate'),
            'calibrated': f'{self.text(name, "calibrated")}{due}',
            'uncertainty': uncertainty,
        }

    def references(self) -> dict[str, str]:
        """Return what is said about gravity, mounting, field and gradient.

        >>> Laboratory({'mounting': {'tilt_half_width': 0.3}}).references()['mounting']
        'tilt at most 0.3°'
        """
        known = {key: self.content.get(key, {}) for key in ('gravity', 'field')}
        field = known['field']
        half, gradient = 'variation_half_width', self.gradient
        told = [
            _quantity(field) if 'expanded_uncertainty' in field else f'strength {NOT_STATED}',
            f'varies by at most {field[half]:g} {field["unit"]}' if half in field else '',
        ]
        return {
            'gravity': _quantity(known['gravity']) if known['gravity'] else NOT_STATED,
            'mounting': NOT_STATED
            if self.tilt is None
            else f'tilt at most {self.content["mounting"]["tilt_half_width"]:g}°',
            'magnetic field': '; '.join(filter(None, told)) if field else NOT_STATED,
            'gradient thermometer to die': NOT_STATED
            if gradient is None
            else f'at most {gradient:g} K',
        }

    def standard_uncertainty(self, instrument: str) -> float | None:
        """Return the standard uncertainty of an instrument's calibration [K], None: not stated."""
        known = self.content.get(instrument, {})
        if 'expanded_uncertainty' not in known:
            return None
        return float(known['expanded_uncertainty']) / float(known.get('coverage_factor', 2.0))

    @property
    def simulated(self) -> bool:
        """Whether the laboratory says that the data were simulated."""
        return bool(self.content.get('simulated', False))

    @property
    def gravity(self) -> tuple[float, float, str]:
        """Local gravity, its standard uncertainty [m/s²], and where both come from."""
        known = self.content.get('gravity', {})
        if not known:
            spread = EARTH_GRAVITY_HALF_WIDTH / math.sqrt(3.0)
            return STANDARD_GRAVITY, spread, 'standard gravity, anywhere on Earth at sea level'
        expanded = float(known.get('expanded_uncertainty', 0.0))
        standard = expanded / float(known.get('coverage_factor', 2.0))
        return float(known['value']), standard, self.text('gravity', 'source')

    @property
    def tilt(self) -> float | None:
        """Half-width of the tilt of the mounting [rad], None where not stated."""
        known = self.content.get('mounting')
        return math.radians(known['tilt_half_width']) if known else None

    @property
    def gradient(self) -> float | None:
        """Half-width of thermometer minus sensing element [K], None where not stated."""
        known = self.content.get('gradient')
        return float(known['half_width']) if known else None

    @property
    def field_variation(self) -> float | None:
        """Half-width of the variation of the magnetic field during a run [T], None: not stated."""
        known = self.content.get('field', {})
        if 'variation_half_width' not in known:
            return None
        return float(known['variation_half_width']) * FIELD_UNITS[known['unit']]

    @property
    def field(self) -> tuple[float | None, float] | None:
        """Strength of the magnetic field and its standard uncertainty [T], None: not stated.

        The strength alone is None where only its uncertainty is stated.
        """
        known = self.content.get('field', {})
        if 'expanded_uncertainty' not in known:
            return None
        factor = FIELD_UNITS[known['unit']]
        standard = float(known['expanded_uncertainty']) / float(known.get('coverage_factor', 2.0))
        value = factor * float(known['value']) if 'value' in known else None
        return value, factor * standard


def _quantity(known: Mapping[str, Any]) -> str:
    """Return value, expanded uncertainty with its factor and source, as far as stated."""
    value = f'{known["value"]:.10g} {known["unit"]}' if 'value' in known else ''
    spread = f'uncertainty {NOT_STATED}'
    if 'expanded_uncertainty' in known:
        k = known.get('coverage_factor', 2.0)
        spread = f'uncertainty {known["expanded_uncertainty"]:g} {known["unit"]} (k = {k:g})'
    return '; '.join(filter(None, (value, spread, known.get('source', ''))))


def read_laboratory(path: Path) -> Laboratory:
    """Return the statements of a YAML file; raise UserError that names file, field and mistake."""
    return Laboratory(read_checked(path, 'laboratory.json'))
