# SPDX-License-Identifier: Apache-2.0
"""plan: what a chamber profile will do, before anything moves."""

from __future__ import annotations

import argparse
import csv
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from chamber_profile.profile.file import load_profile, profile_names
from chamber_profile.profile.timetable import Entry, setpoint_corners, timetable
from chamber_profile.profile.values import Profile

from imu_workbench.answer import Answer
from imu_workbench.report.figures.measured import plan_figure
from imu_workbench.report.html.render import (
    Section,
    figure_html,
    pairs_html,
    render_page,
    table_html,
)

HELP = 'Show the timetable of a chamber profile and check it against its limits.'
EPILOG = f"""\
PROFILE is a YAML file or one of: {', '.join(profile_names())}.
Times are those of an ideal chamber: settling at each dwell and the way from room temperature to
the first set-point come on top."""
CSV_PERIOD_S = 10.0


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('profile', metavar='PROFILE', help='a profile file, or a name (below)')
    parser.add_argument('--html', metavar='FILE', type=Path, help='write timetable and figure')
    parser.add_argument(
        '--csv', metavar='FILE', type=Path, help='write the set-point as time_s,temperature_c'
    )


def run(options: argparse.Namespace) -> Answer:
    """Check the profile and answer with its timetable."""
    profile = load_profile(options.profile)
    entries = timetable(profile)
    content = plan_content(profile, entries)
    if options.csv:
        write_setpoint_csv(options.csv, entries)
    if options.html:
        options.html.write_text(plan_page(content), encoding='utf-8')
    return Answer(content, plan_text(content))


def plan_content(profile: Profile, entries: tuple[Entry, ...]) -> dict[str, Any]:
    """Return the plan as plain values: steps, duration, set-point corners, limits."""
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


def plan_text(content: dict[str, Any]) -> str:
    """Return the plan for the terminal."""
    lines = [f'{content["profile"]}: {content["description"]}']
    lines += [f'{"start":>9} {"lasts":>9}  {"step":<16} {"cycle":>5}  set-point']
    for step in content['steps']:
        number = str(step['cycle']) if step['cycle'] else ''
        lines.append(
            f'{clock(step["start_s"]):>9} {clock(step["duration_s"]):>9}  {step["id"]:<16} '
            f'{number:>5}  {_course(step)}'
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


def _course(step: dict[str, Any]) -> str:
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


def plan_page(content: dict[str, Any]) -> str:
    """Return the plan as one HTML page."""
    hours = np.asarray(content['setpoint']['time_s']) / 3600.0
    series = {'x': hours.tolist(), 'y': np.asarray(content['setpoint']['temperature_c']).tolist()}
    phases = [
        {
            'phase': step['phase'],
            'cycle': step['cycle'],
            'from_h': step['start_s'] / 3600.0,
            'to_h': (step['start_s'] + step['duration_s']) / 3600.0,
        }
        for step in content['steps']
    ]
    figure = plan_figure({'tracks': {'set-point': series}, 'phases': phases})
    limits = content['limits']
    facts = pairs_html(
        {
            'Duration': clock(content['duration_s']),
            'Set-point': f'{content["lowest_c"]:g} … {content["highest_c"]:g} °C',
            'Limits of the air': f'{limits["air_c"][0]:g} … {limits["air_c"][1]:g} °C',
            'Fastest ramp allowed': f'{limits["rate_max_c_per_min"]:g} °C/min',
            'Violations of the limits': 'none',
            'A dwell starts with the': escape(content['dwell_starts']),
            'On abort': f'to {content["on_abort"]["target_c"]:g} °C at '
            f'{content["on_abort"]["rate_c_per_min"]:g} °C/min, then stop',
            'Hash of the profile': f'<code>{content["sha256"]}</code>',
        }
    )
    rows = [
        [
            escape(step['id']), str(step['cycle'] or ''), clock(step['start_s']),
            clock(step['duration_s']), escape(_course(step)),
        ]
        for step in content['steps']
    ]  # fmt: skip
    table = table_html([['step', 'cycle', 'start', 'lasts', 'set-point']], rows, text_columns=(4,))
    caption = 'Set-point over the profile; shaded where it stands.'
    sections = [
        Section('setpoint', 'Set-point', figure_html('plan', caption, caption) + facts,
                {'plan': figure}),
        Section('timetable', 'Timetable', table),
    ]  # fmt: skip
    return render_page(content['profile'], content['description'], sections)


def write_setpoint_csv(path: Path, entries: tuple[Entry, ...]) -> None:
    """Write the set-point every ten seconds, as `emulated_device --temperature` reads it."""
    corners, setpoint = setpoint_corners(entries)
    time = np.unique(np.append(np.arange(0.0, corners[-1], CSV_PERIOD_S), corners))
    with path.open('w', newline='', encoding='utf-8') as stream:
        writer = csv.writer(stream)
        writer.writerow(['time_s', 'temperature_c'])
        for row in zip(time, np.interp(time, corners, setpoint), strict=True):
            writer.writerow([f'{row[0]:.3f}', f'{row[1]:.4f}'])
