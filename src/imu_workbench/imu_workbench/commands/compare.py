# SPDX-License-Identifier: Apache-2.0
"""Compare measurement and model, and say in numbers where the model fails."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from pathlib import Path

from imu_recording.user_error import UserError
from thermal_comp.comparison.across import compare_across
from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.file import load_model
from thermal_comp.presentation.comparison import comparison_text, residual_picture

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_model_argument,
    read_recordings,
)
from imu_workbench.outputs import claim_output

PICTURE_SUFFIXES = ('.png', '.svg', '.pdf')
HELP = 'Compare measured and modelled error per axis: rms, held out, noise floor, worst phase.'
EPILOG = 'example:\n  python -m imu_workbench compare bags/dut1_? --model dut1.yaml'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    add_effects_argument(parser)
    add_model_argument(
        parser, 'model file of `fit`; without it a line per axis is fitted to these bags'
    )
    parser.add_argument(
        '--across',
        action='store_true',
        help="bags of several devices: each device's model on the runs of every other",
    )
    parser.add_argument(
        '--plot', metavar='FILE', type=Path, help='draw the residual over time (.png, .svg, .pdf)'
    )
    parser.add_argument(
        '--force', action='store_true', help='replace what exists under the name of the picture'
    )


def run(options: argparse.Namespace) -> Answer:
    """Compare."""
    if options.plot:
        claim_picture(options.plot, force=options.force)
    model = load_model(options.model, effect_catalogue(options.effects)) if options.model else None
    if options.across:
        return _across(options)
    recordings = read_recordings(options, at_rest=True, model=model)
    show_progress('comparing …')
    runs = prepare(recordings)
    comparison = compare_prepared(model or fit_prepared([BiasTemperature()], runs), runs)
    content = comparison.to_dict()
    lines = [comparison_text(content), *(f'note: {note}' for note in comparison.notes)]
    if options.plot:
        content['plot'] = str(options.plot)
        residual_picture(comparison).savefig(options.plot, dpi=120)
        lines.append(f'wrote {options.plot}')
    return Answer(content, '\n'.join(lines))


def _across(options: argparse.Namespace) -> Answer:
    """Apply the model of every device to every other."""
    if options.model or options.plot:
        raise UserError('--across fits a line to each device: leave --model and --plot away')
    recordings = read_recordings(options, every_device=True, at_rest=True)
    show_progress('comparing across devices …')
    pairs = compare_across([BiasTemperature()], prepare(recordings))
    lines = ['model    on       sensor          raw       own       foreign   compatible']
    lines += [
        f'{pair.model:8} {pair.device:8} {pair.sensor:13} {pair.raw:9.3g} {pair.own:9.3g} '
        f'{pair.foreign:9.3g}   {pair.compatible} of {pair.coefficients}  [{pair.unit}]'
        for pair in pairs
    ]
    good = sum(pair.good_enough for pair in pairs)
    lines.append(f'{good} of {len(pairs)} models are good enough for the other device')
    return Answer({'schema': 1, 'pairs': [pair.to_dict() for pair in pairs]}, '\n'.join(lines))


def claim_picture(target: Path, *, force: bool) -> None:
    """Refuse a picture that exists, unless `force`, and one that cannot be drawn."""
    claim_output(target, force=force)
    if target.suffix not in PICTURE_SUFFIXES:
        raise UserError(
            f'--plot {target}: expected a name that ends with {", ".join(PICTURE_SUFFIXES)}'
        )
    if find_spec('matplotlib') is None:
        raise UserError('--plot needs matplotlib: pip install matplotlib')
