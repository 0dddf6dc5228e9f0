# SPDX-License-Identifier: Apache-2.0
"""What a chamber profile will do, before anything moves."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
import yaml
from chamber_profile.profile.file import load_profile, parse_profile, profile_names
from chamber_profile.profile.timetable import Entry, setpoint_corners, timetable
from chamber_profile.profile.values import Profile
from imu_recording.user_error import UserError

from imu_workbench.answer import CHECK_FAILED, Answer
from imu_workbench.commands.options import add_output_argument
from imu_workbench.fleet import require_fleet
from imu_workbench.outputs import claim_output
from imu_workbench.profile_timetable import timetable_content, timetable_text

HELP = 'Show the timetable of a chamber profile and check it against its limits.'
EPILOG = f"""\
PROFILE is a YAML file or one of: {', '.join(profile_names())}.
Times are those of an ideal chamber: settling at each dwell and the way from room temperature to
the first set-point come on top."""
CSV_PERIOD_S = 10.0


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'profile', metavar='PROFILE', nargs='?', help='a profile file, or a name (below)'
    )
    parser.add_argument(
        '--fleet',
        metavar='DIR',
        type=Path,
        help='results of `fleet`: write the shortest profile its devices say is enough to -o',
    )
    add_output_argument(parser, 'FILE', 'profile to write, with --fleet', required=False)
    parser.add_argument('--html', metavar='FILE', type=Path, help='write timetable and figure')
    parser.add_argument(
        '--csv', metavar='FILE', type=Path, help='write the set-point as time_s,temperature_c'
    )


def run(options: argparse.Namespace) -> Answer:
    """Check the profile and answer with its timetable; or write the profile of a fleet first."""
    if options.fleet:
        return _fleet(options)
    if not options.profile:
        raise UserError('name a PROFILE, or the results of a fleet with --fleet')
    if options.output:
        raise UserError(f'-o {options.output}: it takes the profile of a fleet: give --fleet too')
    return _timetable(options, load_profile(options.profile))


def _fleet(options: argparse.Namespace) -> Answer:
    """Write the shortest campaign that the devices of a fleet say is enough."""
    if options.profile or not options.output:
        raise UserError('--fleet DIR writes a profile: give -o PROFILE and no profile to read')
    require_fleet()
    from imu_workbench.fleet.short_profile import short_profile
    from imu_workbench.fleet.study import fleet_curve
    from imu_workbench.fleet.summary import curve_lines

    claim_output(options.output, force=options.force)
    curve = fleet_curve(options.fleet)
    lines = curve_lines(curve)
    if not curve['shortest']:
        return Answer({'schema': 1, 'shortening': curve}, '\n'.join(lines), CHECK_FAILED)
    text = yaml.safe_dump(short_profile(curve['shortest']), sort_keys=False, allow_unicode=True)
    profile = parse_profile(text, str(options.output))
    options.output.write_text(text, encoding='utf-8')
    answer = _timetable(options, profile)
    lines += [f'saved {options.output}', '', answer.text]
    return Answer({**answer.content, 'shortening': curve}, '\n'.join(lines))


def _timetable(options: argparse.Namespace, profile: Profile) -> Answer:
    entries = timetable(profile)
    content = timetable_content(profile, entries)
    if options.csv:
        write_setpoint_csv(options.csv, entries)
    if options.html:
        from imu_workbench.report.html.profile import profile_page

        options.html.write_text(profile_page(content), encoding='utf-8')
    return Answer(content, timetable_text(content))


def write_setpoint_csv(path: Path, entries: tuple[Entry, ...]) -> None:
    """Write the set-point every ten seconds, as `emulated_device --temperature` reads it."""
    corners, setpoint = setpoint_corners(entries)
    time = np.unique(np.append(np.arange(0.0, corners[-1], CSV_PERIOD_S), corners))
    with path.open('w', newline='', encoding='utf-8') as stream:
        writer = csv.writer(stream)
        writer.writerow(['time_s', 'temperature_c'])
        for row in zip(time, np.interp(time, corners, setpoint), strict=True):
            writer.writerow([f'{row[0]:.3f}', f'{row[1]:.4f}'])
