# SPDX-License-Identifier: Apache-2.0
"""Tables of the live view as HTML: values, environment, attitude, topics, diagnostics."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np
from thermal_comp.presentation.display import DISPLAY_UNITS, SENSORS, duration, fixed

from imu_workbench.report.figures.palette import AXES
from imu_workbench.web.live.readings import (
    LEAST_VERDICT_S,
    MAX_TILT_DEG,
    angle_between_deg,
    attitude,
    chamber_times,
    over_noise,
    rate_hz,
    reading,
    silence_s,
    tilt_since_zero_deg,
    value_of,
    warming_c_per_min,
)
from imu_workbench.web.live.state import LiveState, NodeStatus
from imu_workbench.web.live.topics import DEVICE_ROLES, ROLES

DECIMALS = {'gyroscope': 4, 'accelerometer': 4, 'magnetometer': 2}
"""Decimals in display units: the last digit is a tenth of the noise of a second's mean."""
DRIFT_NOISE_RATIO = 1.5
"""Ratio to the noise from which a static residual is more: flicker alone reaches 1.3."""
MEASURED_ROLES = ('raw', 'compensated', 'raw_field', 'compensated_field')
"""Roles whose samples the verdict is about."""
SILENT_S = 3.0
"""A topic counts as silent after this time without a message."""
STATUS_LEVELS = ('ok', 'warning', 'error', 'stale')
PHASE_LABELS = {
    'precondition': 'preconditioning', 'ramp_down': 'ramp down', 'dwell_cold': 'cold dwell',
    'ramp_up': 'ramp up', 'dwell_hot': 'hot dwell', 'dwell_reference': 'dwell at ambient',
    'final': 'final measurement', 'operator': 'waits for the operator',
}  # fmt: skip
ROLE_NAMES = {'ahrs': 'AHRS', 'setpoint': 'set-point', 'device': 'on the device'}


def table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    """Return a table; cells are HTML."""
    top = ''.join(f'<th scope="col">{cell}</th>' for cell in head)
    body = ''.join(
        '<tr><th scope="row">' + '</th><td>'.join(row[:2]) + '</td>'
        + ''.join(f'<td>{cell}</td>' for cell in row[2:]) + '</tr>'
        for row in rows
    )  # fmt: skip
    return (
        f'<table class="live-table"><caption>{caption}</caption>'
        f'<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'
    )


def values_table(state: LiveState, zero: int) -> str:
    """Return the readings of all sensors, one row per axis."""
    rows = []
    for sensor in SENSORS:
        unit, decimals = DISPLAY_UNITS[sensor], DECIMALS[sensor]
        now = reading(state, sensor, zero)
        columns = (now.raw, now.compensated, now.difference, now.static, now.noise)
        for place, axis in enumerate(AXES):
            numbers = [fixed(float(unit.of(column)[place]), decimals) for column in columns]
            rows.append([f'{sensor} {axis} [{unit.unit}]', *numbers])
    head = ('last second', 'raw', 'compensated', 'raw − comp.', 'static residual', '1σ')
    return table(head, rows, '') + _advice(state, zero)


def verdict(state: LiveState, zero: int, shared: Mapping[str, str] | None = None) -> str:
    """Return in a sentence what compensation leaves over the noise, by the worst axis.

    `shared`: roles whose topic has several publishers; there is no verdict on a mixture.
    """
    mixed = [why for role, why in (shared or {}).items() if role in MEASURED_ROLES]
    if mixed:
        return f'No verdict: {mixed[0]}.'
    if tilt_since_zero_deg(state, zero) > MAX_TILT_DEG:
        return 'No verdict: the device was turned since the zero was taken.'
    ratios = {s: over_noise(state, s, zero) for s in SENSORS}
    known = {s: axes for s, axes in ratios.items() if np.isfinite(axes).any()}
    if not known:
        return f'A verdict needs {LEAST_VERDICT_S} s at rest since the zero.'
    worst = {s: int(np.nanargmax(axes)) for s, axes in known.items()}
    told = {s: f'{s} {AXES[axis]}' for s, axis in worst.items()}
    drifting = {s: float(known[s][axis]) for s, axis in worst.items()}
    beyond = sorted(
        (s for s in drifting if drifting[s] > DRIFT_NOISE_RATIO), key=lambda s: -drifting[s]
    )
    if not beyond:
        largest = max(drifting, key=lambda s: drifting[s])
        return f'What is left is noise: at most {drifting[largest]:.2f} × ({told[largest]}).'
    text = ', '.join(f'{told[s]} {drifting[s]:.1f} ×' for s in beyond)
    return f'Static residual beyond the noise of means of a second: {text}.'


def _advice(state: LiveState, zero: int) -> str:
    tilt = tilt_since_zero_deg(state, zero)
    if tilt > MAX_TILT_DEG:
        return (
            f'<p role="status">The device has been turned by {tilt:.0f}° since the zero was '
            'taken: take a new zero, the static residual counts from there.</p>'
        )
    return (
        '<p>Static residual: what compensation leaves, counted from its mean over the first ten '
        'seconds after the zero. Nothing moves, so all of it is error.</p>'
    )


def environment_values(state: LiveState) -> list[tuple[str, str]]:
    """Return name and value of the chamber's phase, times and temperatures."""
    phase, _, cycle = state.phase.partition(' ')
    shown = PHASE_LABELS.get(phase, phase) or 'no chamber'
    left = [duration(s) if math.isfinite(s) else '–' for s in chamber_times(state.statuses)]
    temperatures = {
        'die': 'temperature', 'on the device': 'device', 'chamber air': 'air',
        'set-point': 'setpoint',
    }  # fmt: skip
    return [
        ('phase', f'{shown}, cycle {cycle}' if cycle not in ('', '0') else shown),
        ('phase ends in', left[0]),
        ('run ends in', left[1]),
        *((label, f'{fixed(value_of(state, n), 2)} °C') for label, n in temperatures.items()),
        ('die warms by', f'{fixed(warming_c_per_min(state), 2)} °C/min'),
    ]


def attitude_table(state: LiveState, shared: Mapping[str, str] | None = None) -> str:
    """Return roll, pitch, yaw of both filters and the angle between them.

    `shared`: roles whose topic has several publishers; the two are then not told apart.
    """
    found = {'complementary': attitude(state, 'complementary'), 'AHRS': attitude(state, 'ahrs')}
    rows = []
    for name, one in found.items():
        angles = [fixed(math.degrees(a), 2) for a in one.euler] if one else ['–'] * 3
        rows.append([name, *angles])
    first, second = found.values()
    apart = f'{fixed(angle_between_deg(first, second), 2)}°' if first and second else '–'
    if set(shared or {}) & {'complementary', 'ahrs'}:
        apart = 'unknown, as both publish on one topic: give each one of its own'
    head = ('sensor → world', 'roll [°]', 'pitch [°]', 'yaw [°]')
    return table(head, rows, '') + f'<p>Between them: {apart}</p>'


def topics_table(state: LiveState, topics: dict[str, str]) -> str:
    """Return every role, its topic, rate and silence."""
    rows = []
    for name in ROLES:
        topic = escape(topics.get(name, '')) or 'not found'
        silence = silence_s(state, name) if name in state.tracks else 0.0
        rate = rate_hz(state, name) if name in state.tracks else 0.0
        heard = f'{fixed(rate, 1)} Hz' if rate else '–'
        if topics.get(name) and silence > SILENT_S:
            heard = f'silent for {duration(silence)}' if math.isfinite(silence) else 'nothing yet'
        rows.append([ROLE_NAMES.get(name, name.replace('_', ' ')), heard, topic])
    found = table(('role', 'heard', 'topic'), rows, '')
    return f'<div class="live-topics">{found}</div>'


def silent_roles(state: LiveState, topics: dict[str, str]) -> list[str]:
    """Return the device's topics that were heard once and are silent now."""
    return [
        topics[name]
        for name in DEVICE_ROLES
        if name in topics and SILENT_S < silence_s(state, name) < math.inf
    ]


def headline(status: NodeStatus, now: float) -> tuple[str, str]:
    """Return the level of a node's status, 'stale' where it is old, and its line."""
    age = now - status.received
    if age < 2 * SILENT_S:
        return STATUS_LEVELS[min(status.level, 3)], f'{status.name}: {status.message}'
    return STATUS_LEVELS[3], f'{status.name}: {status.message} ({duration(age)} ago)'


def details(status: NodeStatus) -> str:
    """Return the values of a node's status."""
    rows = [[escape(key), escape(value)] for key, value in status.values.items()]
    return table(('value', 'now'), rows, '') if rows else 'no values'
