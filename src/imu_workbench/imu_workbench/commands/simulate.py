# SPDX-License-Identifier: Apache-2.0
"""simulate: run a thermal profile with a simulated device and write the bags."""

from __future__ import annotations

import argparse
from pathlib import Path

from imu_driver.simulated_catalogue import DEVICES
from imu_recording.columns_hash import columns_hash

from imu_recording import write_bag
from imu_workbench.answer import Answer
from imu_workbench.experiment import (
    ORIENTATIONS,
    Logging,
    prepare_campaign,
    record_campaign,
)
from imu_workbench.progress import show_progress

HELP = 'simulate a device in a chamber that runs a thermal profile, and write the bags'
AXES = ('x', 'y', 'z', '-x', '-y', '-z')


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of simulate."""
    parser.add_argument('profile', metavar='PROFILE', help='name or YAML file of a profile')
    parser.add_argument('--device', choices=tuple(DEVICES), default='dut1', help='which device')
    parser.add_argument(
        '--orientation', choices=AXES,
        help='the axis that points up: one bag at DIR; without it the bags DIR/x, DIR/y, DIR/z',
    )
    parser.add_argument(
        '--rate', type=float, default=0.5, metavar='HZ', help='rows per second (default 0.5)'
    )
    parser.add_argument('--seed', type=int, default=1, metavar='N', help='seed of all randomness')
    parser.add_argument(
        '-o', '--output', type=Path, required=True, metavar='DIR', help='folder to write'
    )
    parser.add_argument(
        '--mean', action='store_true',
        help='rows are means over their interval instead of single samples',
    )
    parser.add_argument(
        '--chamber-period', type=float, default=1.0, metavar='S',
        help='pace of the chamber topics (default 1 s)',
    )
    parser.add_argument(
        '--field-jumps', action='store_true',
        help="add the level changes between the paper's R1 … R4 to the magnetometer",
    )


def run(options: argparse.Namespace) -> Answer:
    """Simulate, write, and say what was written."""
    _check(options)
    chosen = [f'+{options.orientation}'[-2:]] if options.orientation else list(ORIENTATIONS)
    paths = [options.output] if options.orientation else [
        options.output / axis[-1] for axis in chosen
    ]
    show_progress(f'simulating {len(chosen)} runs of {options.profile} …')
    runs = prepare_campaign(
        options.profile, options.device, seed=options.seed, orientations=chosen,
        field_jumps=options.field_jumps,
    )
    logging = Logging(options.rate, options.mean, options.chamber_period)
    bags, lines = [], []
    for path, prepared in zip(paths, runs, strict=True):
        recording = record_campaign([prepared], logging)[0]
        show_progress(f'writing {path} …')
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bag(recording, path)
        bags.append({
            'path': str(path), 'device': recording.device, 'up_axis': recording.up_axis,
            'samples': len(recording), 'duration_s': float(recording.time[-1]),
            'columns_sha256': columns_hash(recording),
        })
        lines.append(
            f'{path}: {recording.device}, {recording.up_axis} up, {len(recording)} samples in '
            f'{recording.time[-1] / 3600:.2f} h'
        )
    return Answer({'schema': 1, 'bags': bags}, '\n'.join(lines))


def _check(options: argparse.Namespace) -> None:
    if not 0.0 < options.rate <= 952.0:
        raise ValueError(f'--rate {options.rate:g}: choose from above 0 to 952 Hz')
    if options.chamber_period <= 0.0:
        raise ValueError(f'--chamber-period {options.chamber_period:g}: it must be above 0')
    if options.seed < 0:
        raise ValueError(f'--seed {options.seed}: it must not be negative')
