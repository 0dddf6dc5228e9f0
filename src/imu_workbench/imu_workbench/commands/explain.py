# SPDX-License-Identifier: Apache-2.0
"""Explain an effect or a finding: equation, mechanism, what looks like it, how to tell."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.diagnosis.explanations import FINDINGS
from thermal_comp.effects.explanation import explain_all, explanation, explanation_text
from thermal_comp.effects.user_effects import effect_catalogue

from imu_workbench.answer import Answer
from imu_workbench.commands.options import add_effects_argument

HELP = 'Explain an effect or a finding; --all writes the whole catalogue as Markdown.'
EPILOG = 'example:\n  python -m imu_workbench explain thermal_lag'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'effect', metavar='EFFECT', nargs='?', help='name in the catalogue, or of a finding'
    )
    parser.add_argument('--all', action='store_true', help='the whole catalogue as Markdown')
    parser.add_argument(
        '-o',
        '--output',
        metavar='FILE',
        type=Path,
        help='file to write instead of showing the text',
    )
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Explain."""
    catalogue = effect_catalogue(options.effects)
    content: dict[str, Any]
    if options.all or options.effect is None:
        text = explain_all(catalogue)
        content = {name: explanation(effect) for name, effect in catalogue.items()}
    elif options.effect in catalogue:
        effect = catalogue[options.effect]
        content, text = explanation(effect), explanation_text(effect)
    elif options.effect in FINDINGS:
        finding = FINDINGS[options.effect]
        content, text = finding.to_dict(), finding.text()
    else:
        known = ', '.join([*catalogue, *FINDINGS])
        raise UserError(f'effect {options.effect!r} is not known; known: {known}')
    if options.output:
        options.output.write_text(text.rstrip() + '\n', 'utf-8')
        text = f'wrote {options.output}'
    return Answer(content, text)
