# SPDX-License-Identifier: Apache-2.0
"""Sections about the whole report: summary, claims, the paper's own numbers, how to reproduce."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from thermal_comp.presentation.display import SENSORS, duration, fixed, shown

from imu_workbench.report.claims.claim import VERDICT_NAMES
from imu_workbench.report.html.render import Section
from imu_workbench.tables.paper import CITATION

VERDICT_CLASSES = {'supported': 'supported', 'not': 'not', 'untestable': 'open'}
Card = Mapping[str, str]
"""Name, value, unit and detail of a number that is shown large."""


def summary_section(content: Mapping[str, Any]) -> Section:
    """Return what the report found, in a few cards."""
    sensors = (sensor_card(content, sensor) for sensor in SENSORS)
    values = {
        'lead': content['lead'],
        'cards': [
            recordings_card(content),
            *(card for card in sensors if card),
            *attitude_cards(content),
            *([claims_card(content)] if content['follows_paper'] else []),
        ],
        'notes': [
            *(
                f'{device["name"]}: {device[kind]}'
                for device in content['devices']
                for kind in ('problem', 'note')
                if device[kind]
            ),
            *content['left_out'],
        ],
    }
    return Section('summary', content['title'], 'summary.html', values, short='Summary')


def recordings_card(content: Mapping[str, Any]) -> Card:
    """Return how much was recorded."""
    runs, devices = content['recordings'], len(content['devices'])
    seconds = sum(run['duration_s'] for run in runs)
    samples = sum(run['samples'] for run in runs)
    return _card(
        'Recordings',
        str(len(runs)),
        f'run{"s" * (len(runs) > 1)}',
        f'{devices} device{"s" * (devices > 1)}, {duration(seconds)}, {fixed(samples, 0)} samples',
    )


def sensor_card(content: Mapping[str, Any], sensor: str) -> Card | None:
    """Return the certified errors of the channel most times its noise floor; None: none known."""
    channels = [
        (row['ratio'], device, row)
        for device, found in content['certificates'].items()
        for row in found['errors']
        if row['sensor'] == sensor and row['ratio'] is not None and math.isfinite(row['ratio'])
    ]
    if not channels:
        return None
    _, device, row = max(channels, key=lambda channel: channel[0])
    return _card(
        f'{sensor.capitalize()} error (rms), channel farthest above its noise',
        f'{shown(row["before"])} → {shown(row["after"])}',
        row['unit'],
        f'{device} {row["axis"]}: measured → certified model, held out; noise floor '
        f'{shown(row["floor"])} {row["unit"]}',
    )


def attitude_cards(content: Mapping[str, Any]) -> list[Card]:
    """Return σ of the rotation angle per filter, of the first run fast enough for a verdict."""
    cards = []
    for run in [run for run in content['attitudes'] if not run['interpolated']][:1]:
        spread = {
            (found['filter'], found['data']): found['statistics'][0].get('std', {}).get('rotation')
            for found in run['filters']
        }
        for name, label in (('complementary', 'Complementary filter'), ('ahrs', 'AHRS')):
            raw, compensated = spread.get((name, 'raw')), spread.get((name, 'compensated'))
            if raw is not None and compensated is not None:
                cards.append(
                    _card(
                        f'{label}, σ of the rotation angle',
                        f'{shown(raw)} → {shown(compensated)}',
                        '°',
                        f'raw → compensated, {run["name"]}',
                    )
                )
    return cards


def claims_card(content: Mapping[str, Any]) -> Card:
    """Return how many claims of the paper are supported."""
    verdicts = [claim['verdict'] for claim in content['claims']]
    return _card(
        'Claims of the paper',
        str(verdicts.count('supported')),
        f'of {len(verdicts)} supported',
        f'{verdicts.count("not")} not, {verdicts.count("untestable")} untestable here',
    )


def _card(name: str, value: str, unit: str, detail: str) -> Card:
    return {'name': name, 'value': value, 'unit': unit, 'detail': detail}


def claims_section(content: Mapping[str, Any]) -> Section:
    """Return every claim of the paper with its verdict."""
    values = {
        'citation': CITATION,
        'claims': [
            {
                'claim': claim['claim'],
                'look': VERDICT_CLASSES[claim['verdict']],
                'verdict': VERDICT_NAMES[claim['verdict']],
                'ours': '' if claim['verdict'] == 'untestable' else claim['ours'],
                'why': claim['why'],
            }
            for claim in content['claims']
        ],
    }
    return Section('claims', 'Claims of the paper', 'claims.html', values)


def paper_section(content: Mapping[str, Any]) -> Section:
    """Return where the published numbers cannot be right."""
    values = {'notes': content['paper_notes']}
    return Section('paper', 'The paper’s own numbers', 'paper.html', values)


def reproduce_section(content: Mapping[str, Any]) -> Section:
    """Return commands, versions and hashes."""
    values = {
        'commands': content['reproduce']['commands'],
        'versions': content['reproduce']['versions'],
        'hashes': [(run['name'], run['sha256']) for run in content['recordings']],
    }
    return Section('reproduce', 'How to reproduce', 'reproduce.html', values)
