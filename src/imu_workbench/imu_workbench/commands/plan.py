# SPDX-License-Identifier: Apache-2.0
"""What a chamber profile will do, before anything moves."""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import numpy as np
from chamber_profile.profile.file import load_profile, profile_names
from chamber_profile.profile.timetable import Entry, setpoint_corners, timetable

from imu_workbench.answer import Answer
from imu_workbench.profile_timetable import timetable_content, timetable_text

HELP = 'Show the timetable of a chamber profile and check it against its limits.'
EPILOG = f"""\
PROFILE is a YAML file or one of: {', '.join(profile_names())}.
Times are those of an ideal chamber: settling at each dwell and the way from room temperature to
the first set-point come on top."""
CSV_PERIOD_S = 10.0


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('profile', metavar='PROFILE', help='a profile file, or a name (below)')
    parser.add_argument('--html', metavar='FILE', type=Path, help='write timetable and figure')
    parser.add_argument(
        '--csv', metavar='FILE', type=Path, help='write the set-point as time_s,temperature_c'
    )


def run(options: argparse.Namespace) -> Answer:
    """Check the profile and answer with its timetable."""
    profile = load_profile(options.profile)
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
