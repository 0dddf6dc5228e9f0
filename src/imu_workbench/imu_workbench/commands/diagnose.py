# SPDX-License-Identifier: Apache-2.0
"""Say which physical effect is missing in a model, and what the evidence is."""

from __future__ import annotations

import argparse
from pathlib import Path

from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model
from thermal_comp.presentation.diagnosis import diagnosis_text

from imu_workbench.answer import Answer
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_model_argument,
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
    parser.add_argument(
        '--noise-reference',
        metavar='MODEL',
        type=Path,
        help='model file whose noise counts as normal; else the shipped table of the LSM9DS1',
    )
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Diagnose."""
    catalogue = effect_catalogue(options.effects)
    model = load_model(options.model, catalogue) if options.model else None
    reference = None
    if options.noise_reference:
        known = load_model(options.noise_reference, catalogue)
        reference = {s: m.noise for s, m in known.sensors.items() if m.noise is not None}
    found = diagnose(
        stream_recordings(options, at_rest=True, sensors=False, model=model, then='diagnosing …'),
        model,
        catalogue=catalogue,
        reference=reference,
    )
    content = found.to_dict()
    return Answer(content, diagnosis_text(content))
