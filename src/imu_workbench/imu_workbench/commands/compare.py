# SPDX-License-Identifier: Apache-2.0
"""Compare measurement and model, and say in numbers where the model fails."""

from __future__ import annotations

import argparse

from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.file import load_model
from thermal_comp.presentation.comparison import comparison_text

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_model_argument,
    read_recordings,
)

HELP = 'Compare measured and modelled error per axis: rms, held out, noise floor, worst phase.'
EPILOG = 'example:\n  python -m imu_workbench compare bags/dut1_? --model dut1.yaml'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    add_effects_argument(parser)
    add_model_argument(
        parser, 'model file of `fit`; without it a line per axis is fitted to these bags'
    )


def run(options: argparse.Namespace) -> Answer:
    """Compare."""
    model = load_model(options.model, effect_catalogue(options.effects)) if options.model else None
    recordings = read_recordings(options, at_rest=True, model=model)
    show_progress('comparing …')
    runs = prepare(recordings)
    comparison = compare_prepared(model or fit_prepared([BiasTemperature()], runs), runs)
    content = comparison.to_dict()
    notes = (f'note: {note}' for note in comparison.notes)
    return Answer(content, '\n'.join([comparison_text(content), *notes]))
