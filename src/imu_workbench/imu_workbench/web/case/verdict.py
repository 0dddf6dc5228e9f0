# SPDX-License-Identifier: Apache-2.0
"""The verdict in one sentence, defects of the data, and the one thing to do next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from thermal_comp.data.acting_channels import what_to_log
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import COUNT_UNIT
from thermal_comp.presentation.diagnosis import (
    DEFECT_REMEDIES,
    better_left_out,
    corrections_of_thermometer,
    doubtful_sensors,
    erring_thermometer,
    percent,
)
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, shown

from imu_workbench.web.case.version import parameter_text
from imu_workbench.web.case.view import PHASE_LABELS
from imu_workbench.web.words import spaced

AT_FLOOR_RATIO = 1.05
"""An error up to this ratio to the noise floor counts as explained."""
MOST_LEFT_RATIO = 1.3
"""Error over the noise floor that an effect may leave and still explain an error."""
NOT_MISSING = frozenset({'data_quality', 'noise', 'clock'})
"""Kinds of findings that are no missing effect of a sensor."""
WORST_PLACES = 4
"""Number of worst places that decide in which phase a sensor fails."""
Errors = Mapping[str, Mapping[str, float]]
"""Per sensor: held-out `error` and `floor`, rms over the axes [SI unit]."""
Kind = Literal['add', 'experiment', 'log', 'look', 'certificate', 'none']


@dataclass(frozen=True)
class Action:
    """The one thing to do next."""

    kind: Kind
    text: str = ''
    """What to do, where a button cannot do it."""
    effect: str = ''
    sensors: tuple[str, ...] = ()
    rivals: tuple[str, str] = ('', '')
    """Two effects an experiment would tell apart."""


def verdict_sentence(found: Mapping[str, Any], errors: Errors) -> str:
    """Return the verdict: which sensor fails where and by how much, and what explains it."""
    findings = _physical(found)
    if not findings:
        loud = [f for f in found['findings'] if f['kind'] == 'noise']
        names = ' and '.join(dict.fromkeys(_named(f['sensor']) for f in loud))
        usual = f', more than usual in the {names}' if loud else ''
        doubt = doubtful_sensors(found)
        if doubt:
            named = ' and '.join(f'{sensor} ({percent(p)})' for sensor, p in doubt.items())
            return f'Nothing is missing for certain; something may be in the {named}.'
        clock = [f'{_capital(f["text"])}.' for f in found['findings'] if f['kind'] == 'clock']
        erring = erring_thermometer(found)
        left = f'No effect is missing, but the thermometer errs: {erring}.'
        nothing = f'Nothing is missing: what is left is noise{usual}.'
        return ' '.join([left if erring else nothing, *clock])
    sensor = findings[0]['sensor']
    own = [f for f in findings if f['sensor'] == sensor]
    sentence = f'{failure_sentence(sensor, found, errors)} {_explanation(own, found)}'
    others = list(dict.fromkeys(f['sensor'] for f in findings if f['sensor'] != sensor))
    if others:
        names = ' and '.join(_named(other) for other in others)
        sentence += f' The {names} {"lacks" if len(others) == 1 else "lack"} something, too.'
    return sentence


def verdict_of(kept: Mapping[str, Any] | None) -> str:
    """Return the verdict of what a case keeps of a version; '' where it keeps nothing."""
    return verdict_sentence(kept['diagnosis'], kept['errors']) if kept else ''


def failure_sentence(sensor: str, found: Mapping[str, Any], errors: Errors) -> str:
    """Return where a sensor, or several, fail, and how far above the noise."""
    first = next((s for s in sensor.split('+') if s in errors), '')
    name = _named(sensor).capitalize()
    if not first:
        return f'{name}:'
    ratio = errors[first]['error'] / errors[first]['floor']
    verb = 'fail' if '+' in sensor else 'fails'
    place = failing_phase(found['sensors'].get(first, {}).get('where', ()))
    if ratio <= AT_FLOOR_RATIO:
        return f'{name} {"are" if "+" in sensor else "is"} near the noise, {ratio:.2f} ×.'
    return f'{name} {verb}{f" {place}" if place else ""}, {ratio:.1f} × noise.'


def failing_phase(where: Sequence[Mapping[str, Any]]) -> str:
    """Return in words when most of the error is there, from the worst places.

    >>> failing_phase([{'phase': 'ramp_up', 'cycle': 2}, {'phase': 'ramp_down', 'cycle': 1}])
    'in ramps'
    """
    phases = list(dict.fromkeys(w['phase'] for w in where[:WORST_PLACES] if w.get('phase')))
    if not phases:
        return ''
    if all(phase.startswith('ramp') for phase in phases):
        return 'in ramps'
    if all(phase.startswith('dwell') for phase in phases) and len(phases) > 1:
        return 'in dwells'
    return f'in “{PHASE_LABELS[phases[0]]}”' if len(phases) == 1 else 'everywhere'


def _named(sensor: str) -> str:
    return sensor.replace('+', ' and ')


def _explanation(findings: Sequence[Mapping[str, Any]], found: Mapping[str, Any]) -> str:
    first = findings[0]
    if first['kind'] == 'unlogged':
        return f'It follows something that was not logged: {first["depends_on"]}.'
    if first['kind'] == 'unexplained':
        return (
            f'No effect of the catalogue explains it; it follows {first["depends_on"]}, in a form '
            'of its own.'
        )
    if first['kind'] == 'changed':
        return f'The device is no longer what the model says: {spaced(first["text"])}.'
    rivals = first['ambiguous_with']
    if rivals:
        names = ' or '.join([_effect(first), *(spaced(rival) for rival in rivals)])
        return f'{_capital(names)} would explain it; these recordings cannot tell which.'
    named = [f for f in findings if f['kind'] == 'effect']
    verb = 'explains' if len(named) == 1 else 'together explain'
    left = _floors_left(first['sensor'], found)
    what = 'it' if left <= MOST_LEFT_RATIO else f'part of it; {left:.1f} × noise would be left'
    return f'{_capital(" and ".join(map(_effect, named)))} {verb} {what}.'


def _floors_left(sensor: str, found: Mapping[str, Any]) -> float:
    """Return what a correction would leave over the noise floor, 0 where that is not known."""
    parts = [found['prediction'].get(name) or {} for name in sensor.split('+')]
    known = [(p.get('error_after'), p.get('noise_floor')) for p in parts]
    return max((error / floor for error, floor in known if error and floor), default=0.0)


def _effect(finding: Mapping[str, Any]) -> str:
    """Return an effect with its parameters ±, 'thermal lag, 74.0 ± 1.0 s'; several by name."""
    name = spaced(finding['name'])
    texts = {
        key: f'{parameter_text(p["value"], p.get("std"))} {p["unit"]}'.strip()
        for key, p in finding['parameters'].items()
        if p['unit'] != COUNT_UNIT
    }
    several = any(isinstance(p['value'], list) for p in finding['parameters'].values())
    if len(texts) == 1 and not several:
        return f'{name}, {next(iter(texts.values()))},'
    named = ', '.join(f'{spaced(key)} {text}' for key, text in texts.items())
    return f'{name} ({named})' if named else name


def what_would_be_found(found: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return per effect and sensor the least rms that is found; {} where an effect is missing."""
    rows: dict[str, dict[str, str]] = {}
    if _physical(found):
        return rows
    for sensor in SENSORS:
        sizes = found['sensors'].get(sensor, {}).get('smallest_found') or {}
        for effect, rms in sizes.items():
            own = rows.setdefault(effect, {})
            own[sensor] = shown(rms * DISPLAY_UNITS[sensor].factor, 2)
    return dict(sorted(rows.items()))


def smallest_sizes(found: Mapping[str, Any]) -> str:
    """Return the smallest of these sizes of every sensor, with its unit."""
    texts = []
    for sensor in SENSORS:
        sizes = found['sensors'].get(sensor, {}).get('smallest_found')
        if sizes:
            unit = DISPLAY_UNITS[sensor]
            texts.append(f'{shown(min(sizes.values()) * unit.factor, 2)} {unit.unit}')
    return ', '.join(texts)


def _physical(found: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return what is missing, the sensor furthest above its noise first."""
    missing = [f for f in found['findings'] if f['kind'] not in NOT_MISSING]
    return sorted(missing, key=lambda finding: _ratio(finding['sensor'], found), reverse=True)


def _ratio(sensor: str, found: Mapping[str, Any]) -> float:
    """Return the error over the noise floor, of several sensors ('a+b') the largest."""
    rows = [found['sensors'].get(name, {}) for name in sensor.split('+')]
    sizes = [(_size(row.get('held_out_rms')), _size(row.get('noise_floor'))) for row in rows]
    return max((error / floor for error, floor in sizes if floor > 0.0), default=0.0)


def _size(values: Sequence[float | None] | None) -> float:
    """Return the root of the sum of squares of what is known."""
    return math.hypot(*(v for v in values or () if v is not None and math.isfinite(v)))


def data_alerts(found: Mapping[str, Any] | None, notes: Sequence[str]) -> list[str]:
    """Return what is wrong with the recordings themselves, with what to do about it first."""
    alerts = []
    for finding in found['findings'] if found else ():
        if finding['kind'] == 'data_quality':
            advice = DEFECT_REMEDIES.get(finding['name'], '')
            text = spaced(finding['text'])
            alerts.append(f'{text}: {advice}' if advice else text)
    return list(dict.fromkeys((*alerts, *notes)))


def next_action(found: Mapping[str, Any], known: Sequence[str], addable: Sequence[str]) -> Action:
    """Return what to do next; `known` effects have a name here, `addable` ones can be added."""
    findings = _physical(found)
    if not findings:
        return _correction(found, addable) or Action('certificate')
    first = next((f for f in findings if not better_left_out(f)), findings[0])
    if first['kind'] == 'unlogged':
        return Action('log', f'Log {what_to_log(first["depends_on"], EFFECTS)} and record again.')
    if first['kind'] == 'changed':
        return Action('look', 'Fit the device anew: begin a case with a line per axis.')
    if first['kind'] != 'effect':
        return Action('look', f'Look at the residual over {first["depends_on"]}, or load an '
                              'effect of your own.')  # fmt: skip
    effect = str(first['name'])
    if effect not in known or effect not in addable:
        return Action('look', spaced(first['text']))
    sensors = tuple(s for s in SENSORS if s in first['sensor'].split('+'))
    rivals = [rival for rival in first['ambiguous_with'] if rival in known]
    if rivals:
        return Action(
            kind='experiment', text='', effect=effect, sensors=sensors, rivals=(effect, rivals[0])
        )
    if left_out := better_left_out(first):
        return Action('look', f'{_capital(spaced(left_out))}.')
    return Action('add', '', effect, sensors)


def _correction(found: Mapping[str, Any], addable: Sequence[str]) -> Action | None:
    """Return to add what corrects the thermometer's error in most sensors, if anything does."""
    terms = {s: one['terms'] for s, one in corrections_of_thermometer(found).items()}
    named = [name for names in terms.values() for name in names if name in addable]
    if not named:
        return None
    effect = max(named, key=named.count)
    return Action('add', '', effect, tuple(s for s in SENSORS if effect in terms.get(s, ())))


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
