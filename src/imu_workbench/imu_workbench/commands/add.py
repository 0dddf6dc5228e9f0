# SPDX-License-Identifier: Apache-2.0
"""Add a physical effect to a model and refit everything together."""

from __future__ import annotations

import argparse

from imu_recording.user_error import UserError, did_you_mean
from thermal_comp.data.conditions import SENSORS
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.growth import add_effect
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model
from thermal_comp.presentation.growth import growth_text

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_model_argument,
    add_output_argument,
    read_recordings,
    save_unless_worse,
)
from imu_workbench.outputs import claim_output

HELP = 'Add an effect to the model, refit it jointly, show how far the error falls.'
EPILOG = 'example:\n  python -m imu_workbench add thermal_lag bags/dut1_? -o dut1_lag.yaml'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('effect', metavar='EFFECT', help='name in the catalogue')
    add_bag_arguments(parser)
    add_model_argument(parser, 'model to add to; else a line per axis')
    parser.add_argument(
        '--sensor',
        choices=SENSORS,
        action='append',
        default=[],
        help='sensor that gets it; else those in which there is evidence',
    )
    add_output_argument(parser, 'MODEL', 'model file to write')
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Add, refit, compare, save."""
    claim_output(options.output, force=options.force)
    catalogue = effect_catalogue(options.effects)
    if options.effect not in catalogue:
        near = did_you_mean(options.effect, catalogue)
        raise UserError(
            f'effect {options.effect!r} is not known{near}; known: {", ".join(catalogue)}'
        )
    model = load_model(options.model, catalogue) if options.model else None
    recordings = read_recordings(options, at_rest=True, model=model)
    show_progress(f'adding {options.effect} …')
    runs = prepare(recordings)
    growth = add_effect(model, runs, options.effect, Settings(catalogue), options.sensor)
    saved, code = save_unless_worse(growth.model, growth.worse, options)
    content = growth.to_dict() | {'model': None if code else str(options.output)}
    return Answer(content, f'{growth_text(content)}\n{saved}', code)
