# SPDX-License-Identifier: Apache-2.0
"""Add missing effects one after the other until nothing is missing or nothing can be decided."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from thermal_comp.data.preparation import prepare
from thermal_comp.data.quality import QualityFinding, check_quality
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.growth import grow
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model
from thermal_comp.presentation.diagnosis import VERDICTS, undecided_lines, verdict_line
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

HELP = 'Diagnose and add, again and again, until the model is complete or nothing can be decided.'
EPILOG = 'example:\n  python -m imu_workbench auto bags/hidden_effect_? -o model.yaml'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    add_model_argument(parser, 'model to start from; else a line per axis')
    add_output_argument(parser, 'MODEL', 'model file to write')
    parser.add_argument(
        '--named-only',
        action='store_true',
        help='add effects that are named alone, nothing whose cause is undecided',
    )
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Grow the model and save it."""
    claim_output(options.output, force=options.force)
    catalogue = effect_catalogue(options.effects)
    model = load_model(options.model, catalogue) if options.model else None
    clean, defects = check_quality(
        read_recordings(options, at_rest=True, sensors=False, model=model)
    )
    growth = grow(
        model,
        prepare(clean),
        Settings(catalogue),
        show_progress,
        named_only=options.named_only,
    )
    saved, code = save_unless_worse(growth.model, growth.worse, options)
    left = (
        growth.diagnosis.to_dict() if growth.diagnosis else {'verdict': 'complete', 'findings': []}
    )
    content = growth.to_dict() | {
        'verdict': left['verdict'],
        'findings_left': left.get('findings', []),
        'undecided': left.get('undecided', []),
        'data_quality': [f'{d.name}: {d.text}' for d in defects],
        'model': None if code else str(options.output),
    }
    verdict = f'after that: {verdict_line(left)}'
    if left['verdict'] == 'changed':
        verdict = f'{verdict_line(left)}; the coefficients here are fitted anew'
    lines = [*defect_lines(defects), growth_text(content), verdict]
    lines += undecided_lines(content['undecided'])
    return Answer(content, '\n'.join([*lines, saved]), code)


def defect_lines(defects: Sequence[QualityFinding]) -> list[str]:
    """Return what was left out of the recordings before anything was fitted, and why."""
    if not defects:
        return []
    named = dict.fromkeys(f'{defect.name} ({defect.sensor})' for defect in defects)
    return [
        f'{VERDICTS["data_quality"]}: {", ".join(named)}',
        *dict.fromkeys(f'  {defect.text}' for defect in defects),
    ]
