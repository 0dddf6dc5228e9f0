# SPDX-License-Identifier: Apache-2.0
"""The conclusion of a certificate in a sentence: what the model does, and what it lacks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from thermal_comp.comparison.compare import SensorComparison
from thermal_comp.data.conditions import Sensor
from thermal_comp.diagnosis.findings import form_approximate
from thermal_comp.presentation.diagnosis import verdict_line
from thermal_comp.presentation.display import fixed, shown, with_uncertainty

from imu_workbench.report.analysis import Certified

DECISION_WORDS = {'pass': 'kept', 'fail': 'not kept', 'undecided': 'not decided'}


def conclusion(
    certified: Certified,
    shapes: Sequence[Mapping[str, Any]],
    errors: Sequence[Mapping[str, Any]],
    decisions: Sequence[Mapping[str, Any]],
    diagnosis: Mapping[str, Any] | None,
    span: tuple[float, float],
) -> str:
    """Return the outcome in one sentence."""
    ratios = [row for row in errors if math.isfinite(row['ratio'])]
    worst = max(ratios, key=lambda row: row['ratio'], default=None)
    text = f'Between {fixed(span[0], 1)} and {fixed(span[1], 1)} °C a line per axis'
    named = shape_texts(certified, shapes, approximate_forms(certified, diagnosis))
    if named:
        text = f'{text}, with {", ".join(named)},'
    if worst:
        text = (
            f'{text} leaves at most {shown(worst["ratio"], 2)} × the noise '
            f'({worst["sensor"]} {worst["axis"]})'
        )
    grown = [f'{r["sensor"]} {r["axis"]}' for r in ratios if r['after'] > r['before']]
    if grown:
        text = f'{text}; it does not lower the error of {", ".join(grown)}'
    left = still_missing(certified, diagnosis)
    if left:
        text = f'{text}; {left}'
    if decisions:
        counts = {kind: sum(d['decision'] == kind for d in decisions) for kind in DECISION_WORDS}
        told = [f'{n} {DECISION_WORDS[kind]}' for kind, n in counts.items() if n]
        text = f'{text}; of {len(decisions)} limits {", ".join(told)}'
    return f'{text}.'


def approximate_forms(certified: Certified, diagnosis: Mapping[str, Any] | None) -> dict[str, str]:
    """Return the added effects whose form the diagnosis calls approximate: name → why."""
    likeliest: dict[Sensor, Mapping[str, Any]] = {}
    for explanation in diagnosis['explanations'] if diagnosis else ():
        likeliest.setdefault(explanation['sensor'], explanation)
    found: dict[str, list[SensorComparison]] = {}
    for sensor, explanation in likeliest.items():
        for name in explanation['names'] if explanation['approximate'] else ():
            found.setdefault(name, []).append(certified.comparison.sensors[sensor])
    added = {text.partition(' (')[0] for text in certified.added}
    return {name: form_approximate(parts) for name, parts in found.items() if name in added}


def shape_texts(
    certified: Certified, shapes: Sequence[Mapping[str, Any]], approximate: Mapping[str, str]
) -> list[str]:
    """Return every effect beyond the line with its sensors, shape parameters, approximate form."""
    sensors: dict[str, list[str]] = {}
    for sensor, part in certified.model.sensors.items():
        for effect in part.effects:
            if effect.searched or effect.kind != 'device':
                sensors.setdefault(effect.name, []).append(sensor)
    result = []
    for name, where in sensors.items():
        values = [
            f'{parameter.replace("_", " ")} {with_uncertainty(s["value"], s.get("expanded"))} '
            f'{s["unit"]}'
            for s in shapes
            for effect, _, parameter in [s['coefficient'].partition(': ')]
            if effect == name and not parameter[-1].isdigit()
        ]
        details = [f'{"; ".join(dict.fromkeys(values))}, k = 2'] if values else []
        if name in approximate:
            details.append(approximate[name])
        detail = f' ({"; ".join(details)})' if details else ''
        result.append(f'{name.replace("_", " ")} of the {" and ".join(where)}{detail}')
    return result


def still_missing(certified: Certified, diagnosis: Mapping[str, Any] | None) -> str:
    """Return what is missing, by the diagnosis, beyond what was added; '' where nothing is."""
    if diagnosis is None:
        return 'missing effects were not searched for'
    shared = [s for s in diagnosis['steps'] if s['ambiguous_with'] and certified.added]
    if shared:
        names = '; '.join(
            f'{s["added"]} ({s["sensor"]}) cannot be told from {", ".join(s["ambiguous_with"])}'
            for s in shared
        )
        return names.replace('_', ' ')
    others = [
        f for f in diagnosis['findings'] if f['kind'] not in ('effect', 'data_quality', 'clock')
    ]
    if certified.added:
        return '; '.join(f['text'].partition(' (')[0] for f in others).replace('_', ' ')
    if diagnosis['verdict'] == 'complete':
        return 'no further effect was found'
    return verdict_line(diagnosis).replace('_', ' ')
