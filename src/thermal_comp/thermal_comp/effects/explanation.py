# SPDX-License-Identifier: Apache-2.0
"""An effect in words: what `explain` prints and doc/physics.md holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from imu_recording.recording import SENSOR_UNITS

from thermal_comp.effects.effect import Effect

INTRODUCTION = """# Physical effects

What makes the output of a MEMS IMU depend on temperature, and what looks like it. Every effect is
one file in `src/thermal_comp/thermal_comp/effects`; this page is generated from them by
`python -m imu_workbench explain --all -o doc/physics.md`. T is the die temperature, T₀ the
reference temperature, x = T − T₀; {unit} stands for the sensor's SI unit. Device effects belong to
the sensor and are compensated in the field; campaign effects belong to chamber, fixture or session
and are fitted so that they do not spoil the coefficients.
"""


def explanation(effect: type[Effect]) -> dict[str, Any]:
    """Return everything the catalogue knows about an effect."""
    return {
        'name': effect.name,
        'summary': (effect.__doc__ or '').strip().splitlines()[0],
        'kind': effect.kind,
        'sensors': list(effect.sensors),
        'equation': effect.equation,
        'coefficients': [
            {s: unit.replace('{unit}', SENSOR_UNITS[s]) for s in effect.sensors}
            for unit in effect.coefficient_units
        ],
        'parameters': {
            item.name: {
                'unit': item.metadata['unit'],
                'bounds': list(item.metadata['bounds']),
                'default': item.default,
            }
            for item in fields(effect)
        },
        'channels': list(effect.channels),
        'substitutes': list(effect.substitutes),
        'mechanism': effect.mechanism,
        'look_alikes': list(effect.look_alikes),
        'separation': effect.separation,
        'typical_size': effect.typical_size,
        'reference': effect.reference,
    }


def explanation_text(effect: type[Effect]) -> str:
    """Return the effect as lines for the terminal."""
    told = explanation(effect)
    rows = [
        ('equation', told['equation']),
        ('coefficients', '; '.join(_coefficient_lines(told))),
        ('parameters', '; '.join(_parameter_lines(told)) or 'none'),
        ('acts on', f'{", ".join(told["sensors"])} ({told["kind"]} effect)'),
        ('needs', needed_channels(told) or 'nothing beyond temperature and time'),
        ('mechanism', told['mechanism']),
        ('looks like', ', '.join(told['look_alikes'])),
        ('to tell', told['separation']),
        ('typical size', told['typical_size']),
        ('reference', told['reference']),
    ]
    head = f'{told["name"]}: {told["summary"]}'
    return '\n'.join([head, *(f'  {label:<13}{text}' for label, text in rows if text)])


def _coefficient_lines(told: Mapping[str, Any]) -> list[str]:
    """Return the units of the coefficients, each with the sensors that have them."""
    return [
        f'{", ".join(dict.fromkeys(units[sensor] for units in told["coefficients"]))} ({sensor})'
        for sensor in told['sensors']
    ]


def needed_channels(told: Mapping[str, Any]) -> str:
    """Return the channels of an `explanation`, or those of which one is needed; '' for none."""
    between = ' or ' if told['substitutes'] else ', '
    return between.join([*told['channels'], *told['substitutes']])


def explain_all(catalogue: Mapping[str, type[Effect]]) -> str:
    """Return the catalogue as Markdown."""
    parts = [INTRODUCTION]
    for kind in ('device', 'campaign'):
        parts.append(f'## {kind.capitalize()} effects\n')
        parts += [_section(effect) for effect in catalogue.values() if effect.kind == kind]
    return '\n'.join(parts)


def _section(effect: type[Effect]) -> str:
    told = explanation(effect)
    lines = [
        f'### `{told["name"]}`',
        '',
        told['summary'],
        '',
        f'    {told["equation"]}',
        '',
        f'- Coefficients: {_coefficients(effect)}.',
        f'- Acts on: {", ".join(told["sensors"])}.',
    ]
    lines += [f'- Parameter: {line}.' for line in _parameter_lines(told)]
    if told['channels']:
        lines.append(f'- Needs: {needed_channels(told)}.')
    lines += [
        f'- Mechanism: {told["mechanism"]}',
        f'- Looks like: {", ".join(f"`{name}`" for name in told["look_alikes"])}.',
        f'- To tell: {told["separation"]}',
        f'- Typical size: {told["typical_size"]}.',
        f'- Reference: {told["reference"]}.',
        '',
    ]
    return '\n'.join(lines)


def _coefficients(effect: type[Effect]) -> str:
    units = ', '.join(dict.fromkeys(effect.coefficient_units))
    shared = 'shared by two sensors' if effect.coupled else 'of each sensor'
    return f'{units}, {shared}{", new in every run" if effect.per_run else ""}'


def _parameter_lines(told: Mapping[str, Any]) -> list[str]:
    return [
        f'{name} {row["bounds"][0]:g} … {row["bounds"][1]:g}'
        f'{"" if row["unit"] == "1" else " " + row["unit"]}, default {row["default"]}'
        for name, row in told['parameters'].items()
    ]
