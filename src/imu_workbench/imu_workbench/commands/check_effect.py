# SPDX-License-Identifier: Apache-2.0
"""Run the contract tests on the effects a file defines."""

from __future__ import annotations

import argparse
from pathlib import Path

from thermal_comp.effects import EFFECTS
from thermal_comp.effects.contract import check_effect
from thermal_comp.effects.user_effects import effects_in_file, name_is_taken

from imu_workbench.answer import CHECK_FAILED, Answer

HELP = 'Check that the effects of a Python file keep the contract: causal, cut anywhere, finite.'
EPILOG = 'example:\n  python -m imu_workbench check-effect my_effect.py'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('file', metavar='FILE', type=Path, help='Python file with Effect classes')


def run(options: argparse.Namespace) -> Answer:
    """Check."""
    found: dict[str, list[str]] = {}
    effects = effects_in_file(options.file)
    known = {*EFFECTS, *(effect.name for effect in effects)}
    for effect in effects:
        found[effect.name] = check_effect(effect, known)
        if name_is_taken(effect):
            found[effect.name].append(f'{effect.name}: the name is in the catalogue already')
    lines = []
    for name, problems in found.items():
        lines.append(f'{name}: {"keeps the contract" if not problems else "breaks the contract"}')
        lines += [f'  {problem}' for problem in problems]
    broken = any(found.values())
    content = {'effects': found, 'ok': not broken}
    return Answer(content, '\n'.join(lines), exit_code=CHECK_FAILED if broken else 0)
