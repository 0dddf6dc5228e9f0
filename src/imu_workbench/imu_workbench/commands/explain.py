# SPDX-License-Identifier: Apache-2.0
"""Explain an effect, a finding, or a word that verbs print."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping
from pathlib import Path
from textwrap import fill
from typing import Any

from imu_recording.user_error import UserError, did_you_mean
from thermal_comp.diagnosis.explanations import FINDINGS
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.explanation import explain_all, explanation, explanation_text
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.presentation.words import VERDICT_SENTENCES

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
    parameters = parameters_of(catalogue)
    word = re.sub(r'[\s.-]+', '_', (options.effect or '').strip()).lower()
    content: dict[str, Any]
    if options.all or options.effect is None:
        text = explain_all(catalogue)
        content = {name: explanation(effect) for name, effect in catalogue.items()}
    elif word in catalogue:
        effect = catalogue[word]
        content, text = explanation(effect), explanation_text(effect)
    elif word in FINDINGS:
        finding = FINDINGS[word]
        content, text = finding.to_dict(), finding.text()
    elif word in VERDICT_SENTENCES or word in parameters:
        content = {'name': word, 'summary': VERDICT_SENTENCES.get(word) or parameters[word]}
        text = fill(f'{word}: {content["summary"]}', 96, subsequent_indent='  ')
    else:
        known = [*catalogue, *FINDINGS, *VERDICT_SENTENCES, *parameters]
        near = did_you_mean(options.effect, known)
        raise UserError(
            f'{options.effect!r} is no effect, finding or word of an answer{near}; effects: '
            f'{", ".join(catalogue)}'
        )
    if options.output:
        options.output.write_text(text.rstrip() + '\n', 'utf-8')
        text = f'wrote {options.output}'
    return Answer(content, text)


def parameters_of(catalogue: Mapping[str, type[Effect]]) -> dict[str, str]:
    """Return what each shape parameter of the catalogue is: whose, its unit and its bounds."""
    told: dict[str, list[str]] = {}
    for name, effect in catalogue.items():
        for parameter, known in explanation(effect)['parameters'].items():
            low, high = known['bounds']
            told.setdefault(parameter, []).append(
                f'{name} ({low:g} … {high:g} {known["unit"]})'.replace(' )', ')')
            )
    return {
        parameter: f'Shape parameter of {", ".join(effects)}: see `explain` of the effect.'
        for parameter, effects in told.items()
    }
