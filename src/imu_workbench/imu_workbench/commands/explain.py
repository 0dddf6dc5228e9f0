# SPDX-License-Identifier: Apache-2.0
"""Explain an effect, a finding, or a word that verbs print."""

from __future__ import annotations

import argparse
from pathlib import Path
from textwrap import fill
from typing import Any

from imu_recording.user_error import UserError, did_you_mean
from thermal_comp.diagnosis.explanations import FINDINGS
from thermal_comp.effects.explanation import explain_all, explanation, explanation_text
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.presentation.words import WORDS

from imu_workbench.answer import Answer
from imu_workbench.commands.options import add_effects_argument

HELP = 'Explain an effect, a finding or a word of an answer; --all writes the whole catalogue.'
EPILOG = 'example:\n  python -m imu_workbench explain thermal_lag'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'effect',
        metavar='WORD',
        nargs='?',
        help='an effect, a finding, or another word of an answer',
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
    elif options.effect in WORDS:
        content = {'name': options.effect, 'summary': WORDS[options.effect]}
        text = fill(f'{options.effect}: {WORDS[options.effect]}', 96, subsequent_indent='  ')
    else:
        known = [*catalogue, *FINDINGS, *WORDS]
        near = did_you_mean(options.effect, known)
        raise UserError(f'effect {options.effect!r} is not known{near}; known: {", ".join(known)}')
    if options.output:
        options.output.write_text(text.rstrip() + '\n', 'utf-8')
        text = f'wrote {options.output}'
    return Answer(content, text)
