# SPDX-License-Identifier: Apache-2.0
"""Sections of the page that judge: summary, claims, the paper's own numbers, how to reproduce."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, duration, fixed, shown

from imu_workbench.report.claims.claim import VERDICT_NAMES
from imu_workbench.report.html.render import Section, pairs_html, table_html
from imu_workbench.tables.paper import CITATION

VERDICT_CLASSES = {'supported': 'supported', 'not': 'not', 'untestable': 'open'}


def summary_section(content: Mapping[str, Any]) -> Section:
    """Return what the report found, in a few cards."""
    runs = content['recordings']
    seconds = sum(run['duration_s'] for run in runs)
    samples = sum(run['samples'] for run in runs)
    devices = len(content['devices'])
    cards = [
        _card(
            'Recordings',
            f'{len(runs)} <small>run{"s" * (len(runs) > 1)}</small>',
            f'{devices} device{"s" * (devices > 1)}, {duration(seconds)}, '
            f'{fixed(samples, 0)} samples',
        )
    ]
    cards += [card for sensor in SENSORS if (card := _sensor_card(content, sensor))]
    cards += _attitude_cards(content)
    verdicts = [claim['verdict'] for claim in content['claims']]
    cards.append(
        _card(
            'Claims of the paper',
            f'{verdicts.count("supported")} <small>of {len(verdicts)} supported</small>',
            f'{verdicts.count("not")} not, {verdicts.count("untestable")} untestable here',
        )
    )
    problems = ''.join(
        f'<p class="note">{escape(device["name"])}: {escape(device[kind])}</p>'
        for device in content['devices']
        for kind in ('problem', 'note')
        if device[kind]
    )
    problems += ''.join(f'<p class="note">{escape(text)}</p>' for text in content['left_out'])
    said = f'<p class="lead">{escape(content["lead"])}</p>'
    body = f'{said}<div class="cards">{"".join(cards)}</div>{problems}'
    return Section('summary', content['title'], body, short='Summary')


def _sensor_card(content: Mapping[str, Any], sensor: str) -> str:
    parts = [
        found['sensors'][sensor]
        for found in content['comparison'].values()
        if sensor in found['sensors']
    ]
    if not parts:
        return ''
    factor, unit = DISPLAY_UNITS[sensor].factor, DISPLAY_UNITS[sensor].unit

    def worst(name: str) -> float:
        values = [value for part in parts for value in part[name] if value is not None]
        return max(values, default=float('nan')) * factor

    return _card(
        f'{sensor.capitalize()} error, worst channel (rms)',
        f'{shown(worst("measured_rms"))} → {shown(worst("held_out_rms"))} <small>{unit}</small>',
        f'measured → held out; noise floor {shown(worst("noise_floor"))} {unit}',
    )


def _attitude_cards(content: Mapping[str, Any]) -> list[str]:
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
                        f'{shown(raw)} → {shown(compensated)} <small>°</small>',
                        f'raw → compensated, {escape(run["name"])}',
                    )
                )
    return cards


def _card(name: str, value: str, detail: str) -> str:
    return (
        f'<div class="card"><div class="name">{name}</div><div class="value">{value}</div>'
        f'<div class="detail">{detail}</div></div>'
    )


def claims_section(content: Mapping[str, Any]) -> Section:
    """Return a row per claim of the paper."""
    items = ''.join(
        f'<li><div class="head"><b>{escape(claim["claim"])}</b>'
        f'<span class="verdict {VERDICT_CLASSES[claim["verdict"]]}">'
        f'{VERDICT_NAMES[claim["verdict"]]}</span></div>'
        f'{_ours(claim)}<p class="soft small">{escape(claim["why"])}</p></li>'
        for claim in content['claims']
    )
    said = f'<p>Each claim of the paper beside these recordings. {escape(CITATION)}.</p>'
    return Section('claims', 'Claims of the paper', f'{said}<ul class="claims">{items}</ul>')


def _ours(claim: Mapping[str, Any]) -> str:
    return '' if claim['verdict'] == 'untestable' else f'<p>{escape(claim["ours"])}</p>'


def paper_section(content: Mapping[str, Any]) -> Section:
    """Return where the published numbers cannot be right."""
    items = ''.join(
        f'<li><div class="head"><b>{escape(note["place"])}</b></div>'
        f'<p>{escape(note["finding"])}</p></li>'
        for note in content['paper_notes']
    )
    said = (
        '<p>What a careful reader finds in the published numbers; none of it is reproduced '
        'here on purpose.</p>'
    )
    return Section('paper', 'The paper’s own numbers', f'{said}<ul class="claims">{items}</ul>')


def reproduce_section(content: Mapping[str, Any]) -> Section:
    """Return commands, version and hashes."""
    commands = '\n'.join(escape(command) for command in content['reproduce']['commands'])
    hashes = [
        [escape(run['name']), f'<code>{run["sha256"]}</code>'] for run in content['recordings']
    ]
    pairs = {key: escape(str(value)) for key, value in content['reproduce']['versions'].items()}
    return Section(
        'reproduce',
        'How to reproduce',
        f'<pre>{commands}</pre>{pairs_html(pairs)}'
        + table_html([['Run', 'SHA-256 of the decoded columns']], hashes),
    )
