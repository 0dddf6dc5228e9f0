# SPDX-License-Identifier: Apache-2.0
"""Say which physical effect is missing in a model, and what the evidence is."""

from __future__ import annotations

import argparse

from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model
from thermal_comp.presentation.diagnosis import diagnosis_text

from imu_workbench.answer import Answer
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_model_argument,
    add_noise_reference_argument,
    noise_reference,
    stream_recordings,
)

HELP = 'Name the missing physical effect, or say that nothing is missing or nothing explains it.'
EPILOG = 'example:\n  python -m imu_workbench diagnose bags/hidden_effect_? --json diagnosis.json'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    add_model_argument(
        parser, 'model file to examine; without it a line per axis is fitted to these bags'
    )
    add_noise_reference_argument(parser)
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Diagnose."""
    catalogue = effect_catalogue(options.effects)
    model = load_model(options.model, catalogue) if options.model else None
    found = diagnose(
        stream_recordings(options, at_rest=True, sensors=False, model=model, then='diagnosing …'),
        model,
        catalogue=catalogue,
        reference=noise_reference(options, catalogue),
    )
    content = found.to_dict()
    return Answer(content, diagnosis_text(content))
