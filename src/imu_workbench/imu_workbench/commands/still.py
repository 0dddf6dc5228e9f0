# SPDX-License-Identifier: Apache-2.0
"""Find the stretches at rest in logs and bags, and fit curves over temperature to them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from imu_recording.logs.import_log import import_log, is_log
from imu_recording.plausibility import admitted
from imu_recording.user_error import UserError
from thermal_comp.presentation.still import (
    curves_content,
    curves_text,
    rest_content,
    rest_text,
    still_picture,
)
from thermal_comp.still.curves import StillCurves, still_curves
from thermal_comp.still.log import RestingLog, resting_log
from thermal_comp.still.rest import LEAST_REST_S

from imu_recording import ImuRecording, write_bag
from imu_workbench.answer import Answer, show_progress
from imu_workbench.bag_devices import read_devices
from imu_workbench.commands.compare import claim_picture
from imu_workbench.commands.options import (
    add_accept_argument,
    add_output_argument,
    add_topic_arguments,
    save_unless_worse,
    topic_remap,
)
from imu_workbench.outputs import claim_output, replacing

HELP = 'Find the stretches at rest in logs that move; fit curves over temperature to them.'
EPILOG = (
    'Rest is where accelerometer and gyroscope scatter no more than their own noise. Each log\n'
    'has a power-on of its own, each stretch a pose; what is common to all of them is the curve.\n'
    'The model is one like any other: for `apply`, `export` and the node.\n'
    'examples:\n'
    '  python -m imu_workbench still flights/*.ulg                       (only where it rests)\n'
    '  python -m imu_workbench still flights/*.ulg -o board.yaml --plot curves.png\n'
    '  python -m imu_workbench still bags/dut1_motion --bags rests && '
    'python -m imu_workbench auto rests/* -o m.yaml'
)

WORSE_ERROR_RATIO = 1.05
"""Ratio of the errors on held-out logs, with the model and without, from which it is worse."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'logs',
        metavar='LOG',
        type=Path,
        nargs='+',
        help='.ulg, .bin or a bag, one power-on each; without dates, the oldest first',
    )
    parser.add_argument('--imu', metavar='N', type=int, help='IMU of a log that has several')
    parser.add_argument('--namespace', metavar='/NAME', help='device of a bag that has several')
    parser.add_argument('--device', metavar='NAME', help='the device all of them are of')
    parser.add_argument(
        '--least',
        metavar='SECONDS',
        type=float,
        default=LEAST_REST_S,
        help='shortest stretch that counts (%(default)g)',
    )
    parser.add_argument('--bags', metavar='DIR', type=Path, help='write each stretch as a bag')
    parser.add_argument('--plot', metavar='FILE', type=Path, help='draw the curves (.png, …)')
    add_topic_arguments(parser)
    add_accept_argument(parser)
    add_output_argument(parser, 'MODEL', 'model file to write', required=False)


def run(options: argparse.Namespace) -> Answer:
    """Find rest; fit and save where an output is named."""
    if not options.least > 0.0:
        raise UserError(f'--least {options.least:g}: expected a positive number of seconds')
    if options.plot and not options.output:
        raise UserError('--plot draws the curves of a model: name it with -o MODEL')
    if options.plot:
        claim_picture(options.plot, force=options.force)
    if options.output:
        claim_output(options.output, force=options.force)
    logs: list[RestingLog] = []
    for name, recording in _recordings(options):
        show_progress(f'{name}: looking for rest …')
        log, parts = resting_log(recording, _free_name(name, logs), least_s=options.least)
        logs.append(log)
        if options.bags:
            _write_bags(parts, options)
    rows = rest_content(logs)
    content = {'schema': 1, 'logs': rows, 'model': None, 'plot': None}
    lines, code = rest_text(rows), 0
    if options.output:
        show_progress('fitting …')
        curves = still_curves(logs)
        found = curves_content(curves)
        saved, code = save_unless_worse(curves.model, _worsened_sensors(curves), options)
        content |= {'curves': found, 'model': None if code else options.output}
        lines += [*curves_text(found), '', saved]
        if options.plot:
            still_picture(curves).savefig(options.plot, dpi=120)
            content['plot'] = options.plot
            lines.append(f'wrote {options.plot}')
    elif not any(log.runs for log in logs):
        raise UserError('; '.join(f'{log.name}: {log.note}' for log in logs))
    return Answer(content, '\n'.join(lines), code)


def _recordings(options: argparse.Namespace) -> Iterator[tuple[str, ImuRecording]]:
    """Yield name and recording of the chosen device of every log, read when it is asked for."""
    remap = topic_remap(options)
    for path in options.logs:
        show_progress(f'reading {path} …')
        if path.is_file() and is_log(path):
            recording = _imu_of_log(path, options.imu)
        else:
            (recording,) = read_devices(path, options.namespace, remap)
        recording = admitted(recording, options.accept)
        if options.device:
            recording = replace(recording, device=options.device)
        yield path.stem if path.is_file() else path.resolve().name, recording


def _imu_of_log(path: Path, number: int | None) -> ImuRecording:
    imus = {imu.name: imu.recording for imu in import_log(path)}
    names = ', '.join(name.removeprefix('imu') for name in imus)
    if number is None and len(imus) > 1:
        raise UserError(f'{path} has several IMUs ({names}): choose one with --imu')
    wanted = next(iter(imus)) if number is None else f'imu{number}'
    if wanted not in imus:
        raise UserError(f'{path} has no usable IMU {number}; it has {names}')
    return imus[wanted]


def _free_name(name: str, logs: list[RestingLog]) -> str:
    same = sum(log.name.partition(' (')[0] == name for log in logs)
    return f'{name} ({same + 1})' if same else name


def _write_bags(parts: list[ImuRecording], options: argparse.Namespace) -> None:
    for part in parts:
        target = options.bags / part.run.replace('#', '_').replace(' ', '_')
        claim_output(target, force=options.force, folder=True)
        show_progress(f'writing {target} …')
        with replacing(target) as fresh:
            write_bag(part, fresh)


def _worsened_sensors(curves: StillCurves) -> list[str]:
    """Return for which sensors a model enlarges the held-out error: it is not to be saved."""
    return [
        f'{sensor}: its error on the logs that were left out is larger with the model'
        for sensor, part in curves.sensors.items()
        if np.mean(part.held_out**2) > WORSE_ERROR_RATIO**2 * np.mean(part.raw**2)
    ]
