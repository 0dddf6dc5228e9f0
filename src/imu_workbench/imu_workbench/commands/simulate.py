# SPDX-License-Identifier: Apache-2.0
"""Run a thermal profile with a simulated device and write the bags."""

from __future__ import annotations

import argparse
import math
import os
import re
from pathlib import Path
from typing import Any

from imu_driver.simulation.devices import DEVICES
from imu_driver.simulation.hidden import HIDEABLE, NOTHING, check_hideable
from imu_driver.simulation.population import draw_lots
from imu_recording.recording import columns_hash
from imu_recording.user_error import UserError
from thermal_comp.data.conditions import SENSORS

from imu_recording import ImuRecording, write_bag
from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import add_effects_argument, add_output_argument
from imu_workbench.outputs import claim_output, replacing
from imu_workbench.simulate.campaign import ORIENTATIONS, Logging, simulate_campaign, simulate_run
from imu_workbench.simulate.fleet import FleetPlan, write_fleet
from imu_workbench.simulate.hidden_effect import (
    TRUTH_FILE,
    EffectToHide,
    hidden_campaign,
    write_truth,
)
from imu_workbench.simulate.own_effect import own_effects

HELP = 'Simulate a device in a chamber that runs a thermal profile; write the bags.'
EPILOG = 'What --hide can hide: ' + ', '.join(HIDEABLE)
ORIENTATION_CHOICES = ('x', 'y', 'z', '-x', '-y', '-z')
SENSOR_CHOICES = (*SENSORS, 'accelerometer+magnetometer')


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    # argparse takes '-x' for an option unless it counts as a negative number.
    parser._negative_number_matcher = re.compile(r'^-(\d+|\d*\.\d+|[xyz])$')
    parser.add_argument('profile', metavar='PROFILE', help='name or YAML file of a profile')
    parser.add_argument('--device', choices=tuple(DEVICES), default='dut1', help='which device')
    parser.add_argument(
        '--orientation',
        choices=ORIENTATION_CHOICES,
        help='the axis that points up: one bag at DIR; without it the bags DIR/x, DIR/y, DIR/z',
    )
    parser.add_argument(
        '--rate', type=float, default=0.5, metavar='HZ', help='rows per second (default 0.5)'
    )
    parser.add_argument('--seed', type=int, default=1, metavar='N', help='seed of all randomness')
    add_output_argument(parser, 'DIR', 'folder to write')
    add_effects_argument(parser)
    parser.add_argument(
        '--mean',
        action='store_true',
        help='rows are means over their interval instead of single samples',
    )
    parser.add_argument(
        '--chamber-period',
        type=float,
        default=1.0,
        metavar='S',
        help='pace of the chamber topics (default 1 s)',
    )
    parser.add_argument(
        '--field-jumps',
        action='store_true',
        help="add the level changes between the paper's R1 … R4 to the magnetometer",
    )
    parser.add_argument(
        '--hide',
        metavar='EFFECT[,…]',
        help='hide effects or faults, or random ones; rows are means then, and the truth goes '
        f'to DIR/{TRUTH_FILE}, which only `reveal DIR` opens',
    )
    parser.add_argument(
        '--magnitude',
        default='2',
        metavar='M[,…]',
        help='rms of a hidden effect beyond a line in temperature, in standard deviations of a '
        'one-second mean: one for each, or one for all (default 2)',
    )
    parser.add_argument(
        '--sensor',
        metavar='SENSOR[,…]',
        help=f'where to hide each, or all: {", ".join(SENSOR_CHOICES)} (default: by seed)',
    )
    parser.add_argument(
        '--fleet',
        type=int,
        metavar='N',
        help='N devices drawn from a population, one folder each; rows are means, and what the '
        'lots are made of, which devices are odd and which effects are hidden goes to '
        f'DIR/{TRUTH_FILE}, which only `reveal DIR` opens',
    )
    parser.add_argument('--lots', type=int, metavar='K', help='lots of the fleet (default 1)')
    parser.add_argument(
        '--aged',
        action='store_true',
        help='the same device a year later, on another day: slopes, offsets and what --hide hides '
        'have changed, by how much only `reveal DIR` tells; with the --seed of a year ago, which '
        'drew what is hidden',
    )


def run(options: argparse.Namespace) -> Answer:
    """Simulate, write, and say what was written."""
    _check(options)
    if options.fleet is not None:
        return _fleet(options)
    logging = Logging(options.rate, options.mean or bool(options.hide), options.chamber_period)
    truth = options.output / TRUTH_FILE
    if truth.exists() and not options.force:
        raise UserError(f'{options.output}: holds a hidden effect already; name another folder')
    _claim(options)
    if options.hide or options.aged:
        return _hidden(options, logging)
    if options.orientation:
        axis = options.orientation if options.orientation[0] == '-' else f'+{options.orientation}'
        show_progress(f'simulating {options.profile} …')
        recording = simulate_run(
            options.profile,
            options.device,
            logging,
            seed=options.seed,
            orientation=axis,
            field_jumps=options.field_jumps,
        )
        return _written([options.output], [recording])
    show_progress(f'simulating {len(ORIENTATIONS)} runs of {options.profile} …')
    recordings = simulate_campaign(
        options.profile,
        options.device,
        logging,
        seed=options.seed,
        field_jumps=options.field_jumps,
    )
    truth.unlink(missing_ok=True)
    return _written(_paths(options), recordings)


def _fleet(options: argparse.Namespace) -> Answer:
    """Stream a population to bags."""
    lots = options.lots or 1
    plan = FleetPlan(
        profile=options.profile,
        devices=options.fleet,
        lots=lots,
        seed=options.seed,
        logging=Logging(options.rate, mean=True, chamber_period=options.chamber_period),
    )
    bags = write_fleet(plan, options.output, len(os.sched_getaffinity(0)))
    content = {'schema': 1, 'devices': options.fleet, 'lots': lots, 'bags': bags}
    return Answer(
        content,
        f'{options.output}: {options.fleet} devices in {lots} lots, {bags} bags\n'
        f'next: `fleet {options.output} -o FLEET`, then '
        f'`reveal {options.output} --fleet FLEET`',
    )


def _hidden(options: argparse.Namespace, logging: Logging) -> Answer:
    show_progress(f'simulating {len(ORIENTATIONS)} runs of {options.profile} …')
    campaign = hidden_campaign(
        options.profile,
        options.device,
        logging,
        _hidden_effects(options),
        seed=options.seed,
        aged=options.aged,
        own=own_effects(options.effects),
    )
    answer = _written(_paths(options), campaign.recordings)
    write_truth(
        options.output / TRUTH_FILE,
        campaign,
        device=options.device,
        seed=options.seed,
        profile=options.profile,
        bags=[path.name for path in _paths(options)],
    )
    finder = '`diagnose --model` of an earlier campaign' if options.aged else '`diagnose`'
    hint = f'hidden: see whether {finder} finds it, then `reveal {options.output}`'
    return Answer(answer.content, f'{answer.text}\n{hint}')


def _hidden_effects(options: argparse.Namespace) -> list[EffectToHide]:
    """Return what to hide in which sensor, with the magnitude of each, or one for all."""
    names = (options.hide or NOTHING).split(',')
    for name in names:
        if name != 'random':
            check_hideable(name, own_effects(options.effects))
    magnitudes = [_magnitude(text) for text in _for_each('magnitude', options.magnitude, names)]
    sensors = _for_each('sensor', options.sensor or '', names)
    for sensor in sensors:
        if sensor not in ('', *SENSOR_CHOICES):
            raise UserError(f'--sensor {sensor}: choose from {", ".join(SENSOR_CHOICES)}')
    return [
        EffectToHide(name, magnitude, sensor or None)
        for name, magnitude, sensor in zip(names, magnitudes, sensors, strict=True)
    ]


def _for_each(option: str, text: str, names: list[str]) -> list[str]:
    given = text.split(',')
    if len(given) == 1:
        return given * len(names)
    if len(given) != len(names):
        raise UserError(
            f'--{option} {text}: has {len(given)} values for {len(names)} effects of --hide; '
            'give one for each, or one for all'
        )
    return given


def _magnitude(text: str) -> float:
    try:
        magnitude = float(text)
    except ValueError:
        magnitude = math.nan
    if not 0.0 < magnitude < math.inf:
        raise UserError(f'--magnitude {text}: it must be a number above 0')
    return magnitude


def _claim(options: argparse.Namespace) -> None:
    """Refuse a bag, or a folder of bags, that holds something already, unless --force."""
    folder = options.output
    if options.orientation:
        claim_output(folder, force=options.force, folder=True)
        return
    if folder.is_dir() and any(folder.iterdir()) and not options.force:
        raise UserError(
            f'{folder} exists already and is not empty: choose another -o, or write into it with '
            '--force'
        )
    for path in _paths(options):
        claim_output(path, force=options.force, folder=True)


def _paths(options: argparse.Namespace) -> list[Path]:
    return [options.output / axis[-1] for axis in ORIENTATIONS]


def _written(paths: list[Path], recordings: list[ImuRecording]) -> Answer:
    """Write the bags and say so."""
    bags: list[dict[str, Any]] = []
    lines = []
    for path, recording in zip(paths, recordings, strict=True):
        show_progress(f'writing {path} …')
        with replacing(path) as fresh:
            write_bag(recording, fresh)
        bags.append(
            {
                'path': str(path),
                'device': recording.device,
                'up_axis': recording.up_axis,
                'samples': len(recording),
                'duration_s': float(recording.time[-1]),
                'columns_sha256': columns_hash(recording),
            }
        )
        lines.append(
            f'{path}: {recording.device}, {recording.up_axis} up, {len(recording)} samples in '
            f'{recording.time[-1] / 3600:.2f} h'
        )
    return Answer({'schema': 1, 'bags': bags}, '\n'.join(lines))


def _check(options: argparse.Namespace) -> None:
    if not 0.0 < options.rate <= 952.0:
        raise UserError(f'--rate {options.rate:g}: choose from above 0 to 952 Hz')
    if options.chamber_period <= 0.0:
        raise UserError(f'--chamber-period {options.chamber_period:g}: it must be above 0')
    if options.seed < 0:
        raise UserError(f'--seed {options.seed}: it must not be negative')
    if options.fleet is not None or options.lots is not None:
        _check_fleet(options)
    if options.sensor and not options.hide:
        raise UserError('--sensor says where to hide something: it needs --hide')
    if options.hide or options.aged:
        _check_hidden(options)


def _check_fleet(options: argparse.Namespace) -> None:
    if options.fleet is None:
        raise UserError(f'--lots {options.lots}: it divides a fleet: give --fleet N too')
    draw_lots(1 if options.lots is None else options.lots, options.seed)
    if options.fleet < (options.lots or 1):
        raise UserError(
            f'--fleet {options.fleet}: it must be at least 1, and a device for each lot'
        )
    if options.hide or options.aged or options.orientation or options.field_jumps:
        raise UserError(
            '--fleet draws its own devices and effects in all three orientations: leave --hide, '
            '--aged, --orientation and --field-jumps away'
        )


def _check_hidden(options: argparse.Namespace) -> None:
    _hidden_effects(options)
    if options.orientation or options.field_jumps:
        raise UserError(
            f'{"--hide" if options.hide else "--aged"} makes all three orientations and nothing '
            'beside what it hides: leave --orientation and --field-jumps away'
        )
    if options.hide and options.rate > 10.0:
        raise UserError(f'--rate {options.rate:g}: with --hide rows are means, at most 10 Hz')
