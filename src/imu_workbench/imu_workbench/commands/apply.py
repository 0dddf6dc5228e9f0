# SPDX-License-Identifier: Apache-2.0
"""Compensate bags with a model and write them as bags."""

from __future__ import annotations

import argparse
from pathlib import Path

from imu_recording.bags.compensated_copy import write_compensated_copy
from imu_recording.user_error import UserError
from thermal_comp.compensation.recording import (
    DEFAULT_EXTRAPOLATION,
    EXTRAPOLATIONS,
    TIMEOUT_S,
    compensate,
)
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_model_argument,
    add_output_argument,
    read_recordings,
    topic_remap,
)
from imu_workbench.outputs import claim_output, replacing

HELP = 'Subtract the modelled error from bags; write compensated bags.'
EPILOG = (
    'One bag is written to DIR, several to DIR/<bag>.\n'
    'example:\n  python -m imu_workbench apply bags/dut1_x --model dut1.yaml -o dut1_x_compensated'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    add_effects_argument(parser)
    add_model_argument(parser, 'model file of `fit`', required=True)
    add_output_argument(parser, 'DIR', 'bag to write')
    parser.add_argument(
        '--temperature-timeout',
        metavar='SECONDS',
        type=float,
        default=TIMEOUT_S,
        help='age from which a die temperature is not used, as of the node (%(default)g)',
    )
    parser.add_argument(
        '--extrapolate',
        choices=EXTRAPOLATIONS,
        default=DEFAULT_EXTRAPOLATION,
        help='outside the fitted temperatures go on as a tangent, or keep the error of the edge, '
        'as of the node (%(default)s, which leaves less: benchmarks/extrapolation.py)',
    )


def run(options: argparse.Namespace) -> Answer:
    """Compensate and write."""
    if not options.temperature_timeout > 0.0:
        raise UserError(
            f'--temperature-timeout {options.temperature_timeout:g}: expected a positive number'
        )
    model = load_model(options.model, effect_catalogue(options.effects))
    recordings = read_recordings(options, model=model)
    targets = output_paths(options.bags, options.output, force=options.force)
    rows, lines = [], []
    remap = topic_remap(options)
    for recording, bag, target in zip(recordings, options.bags, targets, strict=True):
        show_progress(f'writing {target} …')
        compensated = compensate(
            recording,
            model,
            temperature_timeout=options.temperature_timeout,
            again='compensated' in options.accept,
            extrapolation=options.extrapolate,
        )
        with replacing(target) as fresh:
            write_compensated_copy(compensated, bag, fresh, remap)
        notes = compensated.notes  # also of what was left out on reading
        rows.append({
            'bag': recording.source,
            'output': target,
            'notes': notes,
            'unplaced': dict(recording.unplaced),
        })  # fmt: skip
        lines += [f'wrote {target}: {len(recording)} samples', *(f'  note: {n}' for n in notes)]
    return Answer({'schema': 1, 'model': options.model, 'bags': rows}, '\n'.join(lines))


def output_paths(bags: list[Path], output: Path, *, force: bool = False) -> list[Path]:
    """Return where each bag goes: DIR for one, DIR/<bag> for several."""
    names = [bag.resolve().name for bag in bags]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise UserError(f'two bags are called {twice}: apply them one at a time')
    targets = [output] if len(bags) == 1 else [output / name for name in names]
    for target in targets:
        claim_output(target, force=force, folder=True)
    return targets
