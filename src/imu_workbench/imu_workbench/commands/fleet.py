# SPDX-License-Identifier: Apache-2.0
"""Estimate many devices, then say what they share and which are odd."""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

from imu_recording.user_error import UserError

from imu_workbench.answer import Answer, show_progress, write_json
from imu_workbench.commands.options import add_effects_argument
from imu_workbench.fleet import require_fleet

HELP = 'Estimate many devices on a cluster; what they share, which are odd; one page of it.'
EPILOG = """\
example:
  python -m imu_workbench simulate short_20min --fleet 200 --lots 4 --seed 3 -o fleet_bags
  python -m imu_workbench fleet fleet_bags -o fleet_out

SOURCE is a bag, a case, a folder with bags or cases at any depth, a glob, a URL that fsspec knows
(s3://, ssh://), or a list: .txt with a source a line, .csv with the columns source, lot, type.
Without a list the lot is the part of the path that is written lot=NAME. Bags of one device stand
in one folder.
Effects of --effects are tried as those of the catalogue are; with --scheduler their files stand
under the same path on each host.
A run that was interrupted goes on where it was; a device is estimated again where its files, the
settings or the version have changed."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'sources', nargs='+', metavar='SOURCE', help='where the bags or cases are (below)'
    )
    parser.add_argument(
        '-o',
        '--output',
        metavar='DIR',
        type=Path,
        required=True,
        help='folder of the results; one that holds results is brought up to date',
    )
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', default='', help='a running Dask scheduler, tcp://…'
    )
    parser.add_argument(
        '--workers', type=int, metavar='N', help='processes on this machine (default: its cores)'
    )
    parser.add_argument(
        '--memory', metavar='SIZE', help='limit of each (default 500MB, 2GB with --diagnose)'
    )
    parser.add_argument(
        '--limits',
        metavar='YAML',
        type=Path,
        help='limits of slopes: each lot gets its process capability Cpk',
    )
    parser.add_argument(
        '--served',
        metavar='URL',
        default='',
        help='address of `serve` with these cases: the page leads into them',
    )
    parser.add_argument(
        '--diagnose', action='store_true', help='also diagnose each device by itself (slow)'
    )
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Estimate what is new, then study all."""
    require_fleet()
    from thermal_comp.effects.user_effects import effect_catalogue

    from imu_workbench.fleet.engine import Cluster, checked_memory, run_fleet
    from imu_workbench.fleet.estimate import EstimateSettings
    from imu_workbench.fleet.page import fleet_page
    from imu_workbench.fleet.sources import find_devices
    from imu_workbench.fleet.study import study
    from imu_workbench.fleet.summary import failed_lines, study_lines
    from imu_workbench.report.limits import read_limits

    workers = len(os.sched_getaffinity(0)) if options.workers is None else options.workers
    memory = options.memory or ('2GB' if options.diagnose else '500MB')
    if workers < 1:
        raise UserError(f'--workers {options.workers}: it must be at least 1')
    memory = checked_memory(memory)
    if options.output.exists() and not options.output.is_dir():
        raise UserError(f'{options.output} is a file: results need a folder')
    if options.served and not options.served.startswith(('http://', 'https://')):
        raise UserError(f'--served {options.served}: the address that `serve` prints, http://…')
    limits = read_limits(options.limits) if options.limits else None
    catalogue = effect_catalogue(options.effects)
    show_progress('looking for bags …')
    devices = find_devices(options.sources)
    progress = run_fleet(
        devices,
        options.output,
        EstimateSettings.of(options.effects, diagnose=options.diagnose),
        Cluster(options.scheduler, workers, memory),
        clock=time.time_ns,
        report=show_progress,
    )
    done = f'{progress.estimated} estimated, {progress.unchanged} unchanged'
    show_progress('studying the fleet …')
    found = study(options.output, limits, catalogue)
    write_json(found, options.output / 'study.json')
    page = options.output / 'report.html'
    page.write_text(fleet_page(found, options.output, options.served), encoding='utf-8')
    text = [f'{progress.devices} devices: {done}, {len(found["failed"])} without an estimate']
    text += failed_lines(found['failed'])
    run_content = {
        'devices': progress.devices,
        'estimated': progress.estimated,
        'unchanged': progress.unchanged,
        'failed': progress.failed,
    }
    return Answer(
        {**found, 'run': run_content}, '\n'.join([*text, *study_lines(found), f'page: {page}'])
    )
