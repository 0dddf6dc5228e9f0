# SPDX-License-Identifier: Apache-2.0
"""Timetable of a chamber profile: as plain values and as the terminal shows it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from chamber_profile.profile.timetable import Entry, setpoint_corners
from chamber_profile.profile.values import Profile


def timetable_content(profile: Profile, entries: tuple[Entry, ...]) -> dict[str, Any]:
    """Return the timetable as plain values: steps, duration, set-point corners, limits."""
    time, setpoint = setpoint_corners(entries)
    limits = profile.limits
    return {
        'schema': 1,
        'profile': profile.name,
        'description': profile.description,
        'norm': profile.norm,
        'sha256': profile.sha256,
        'duration_s': entries[-1].end_s,
        'cycles': max(entry.cycle for entry in entries),
        'orientations': list(profile.orientations),
        'limits': {
            'air_c': [limits.air_min_c, limits.air_max_c],
            'device_c': [limits.device_min_c, limits.device_max_c],
            'rate_max_c_per_min': limits.rate_max_c_per_min,
        },
        'lowest_c': float(setpoint.min()),
        'highest_c': float(setpoint.max()),
        'violations': [],
        'dwell_starts': _dwell_rule(profile),
        'on_abort': {
            'target_c': profile.on_abort.target_c,
            'rate_c_per_min': profile.on_abort.rate_c_per_min,
        },
        'steps': [_step_content(entry) for entry in entries],
        'setpoint': {'time_s': time, 'temperature_c': setpoint},
    }


def _step_content(entry: Entry) -> dict[str, Any]:
    rate = (entry.to_c - entry.from_c) / entry.move_s * 60.0 if entry.move_s else 0.0
    return {
        'id': entry.id,
        'kind': entry.kind,
        'phase': entry.phase,
        'cycle': entry.cycle,
        'orientation': entry.orientation,
        'start_s': entry.start_s,
        'duration_s': entry.end_s - entry.start_s,
        'from_c': entry.from_c,
        'to_c': entry.to_c,
        'rate_c_per_min': round(rate, 9),
        'dwell_s': entry.dwell_s,
    }


def _dwell_rule(profile: Profile) -> str:
    criteria = [step.stabilise for step in profile.run_steps if step.stabilise]
    if not criteria:
        return 'no dwell'
    rule = criteria[-1]
    text = f'{rule.source} within {rule.band_c:g} K of the set-point'
    if rule.hold_s:
        text += f' for {rule.hold_s:g} s'
    if rule.max_rate_c_per_min is not None:
        text += f', moving at most {rule.max_rate_c_per_min:g} K/min'
    modes = sorted({step.dwell_mode for step in profile.run_steps if step.stabilise})
    return f'{text}; dwell clock {" or ".join(modes)}'


def timetable_text(content: Mapping[str, Any]) -> str:
    """Return the timetable for the terminal."""
    lines = [f'{content["profile"]}: {content["description"]}']
    lines += [f'{"start":>9} {"lasts":>9}  {"step":<16} {"cycle":>5}  set-point']
    for step in content['steps']:
        number = str(step['cycle']) if step['cycle'] else ''
        lines.append(
            f'{clock(step["start_s"]):>9} {clock(step["duration_s"]):>9}  {step["id"]:<16} '
            f'{number:>5}  {course(step)}'
        )
    limits = content['limits']
    low, high = limits['air_c']
    lines.append(
        f'{clock(content["duration_s"]):>9} in all; {content["lowest_c"]:g} … '
        f'{content["highest_c"]:g} °C within {low:g} … {high:g} °C, at most '
        f'{limits["rate_max_c_per_min"]:g} °C/min: no violation of the limits'
    )
    lines.append(f'a dwell starts with the {content["dwell_starts"]}')
    return '\n'.join(lines)


def course(step: Mapping[str, Any]) -> str:
    """Return what the set-point does during a step."""
    if step['from_c'] == step['to_c']:
        return f'{step["to_c"]:g} °C'
    return f'{step["from_c"]:g} → {step["to_c"]:g} °C at {step["rate_c_per_min"]:+.3g} °C/min'


def clock(seconds: float) -> str:
    """Return a time as hours, minutes and seconds.

    >>> clock(43_200), clock(90)
    ('12:00:00', '0:01:30')
    """
    whole = round(seconds)
    return f'{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}'
