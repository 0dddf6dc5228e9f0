# SPDX-License-Identifier: Apache-2.0
"""Plan the experiment that best tells two rival effects apart."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import yaml
from chamber_profile.profile.file import load_profile
from imu_recording.user_error import UserError
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.experiment.design import SEPARATING_EVIDENCE, ChamberLimits, design_experiment
from thermal_comp.experiment.plan import REFERENCE_C
from thermal_comp.model.file import load_model
from thermal_comp.model.values import ThermalModel

from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_effects_argument,
    add_model_argument,
    add_output_argument,
)
from imu_workbench.outputs import claim_output
from imu_workbench.proposed_profile import profile_content

HELP = 'Find the chamber profile that best separates two rival effects; write it as a profile.'
EPILOG = (
    'example:\n  python -m imu_workbench next-experiment thermal_lag temperature_rate '
    '--model model.yaml -o profile.yaml'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('effects_a', metavar='A', help='one effect')
    parser.add_argument('effects_b', metavar='B', help='its rival')
    add_model_argument(parser, 'model of the device', required=True)
    parser.add_argument(
        '--range',
        metavar=('LOW', 'HIGH'),
        type=float,
        nargs=2,
        default=(-10.0, 50.0),
        help='temperatures the chamber may go to [°C]',
    )
    parser.add_argument(
        '--max-rate', metavar='RATE', type=float, default=2.0, help='fastest ramp [°C/min]'
    )
    parser.add_argument('--hours', type=float, default=12.0, help='longest run [h]')
    parser.add_argument('--seed', type=int, default=0, help='seed of the search')
    add_output_argument(parser, 'PROFILE', 'profile to write')
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Design, write, read back."""
    claim_output(options.output, force=options.force)
    low, high = options.range
    if not low < REFERENCE_C < high:
        raise UserError(f'--range {low:g} {high:g}: expected LOW < {REFERENCE_C:g} < HIGH')
    if options.max_rate <= 0.0 or options.hours <= 0.0:
        raise UserError('--max-rate and --hours: expected more than 0')
    catalogue = dict(effect_catalogue(options.effects))
    model = load_model(options.model, catalogue)
    limits = ChamberLimits(low, high, options.max_rate, options.hours)
    names = (options.effects_a, options.effects_b)
    show_progress('searching a profile …')
    proposal = design_experiment(names, model, limits, catalogue, seed=options.seed)
    text = yaml.safe_dump(
        profile_content(proposal, names, limits), sort_keys=False, allow_unicode=True
    )
    options.output.write_text(text, 'utf-8')
    load_profile(options.output)
    content: dict[str, Any] = {
        'schema': 1,
        'effects': list(names),
        'sensor': proposal.sensor,
        'assumed': assumed_sizes(names, model, proposal.sensor),
        'evidence_before': proposal.evidence_before,
        'evidence_after': proposal.evidence_after,
        'evidence_needed': SEPARATING_EVIDENCE,
        'separable': proposal.separable,
        'actions': list(proposal.actions),
        'hours': proposal.plan.hours,
        'repeats': proposal.plan.repeats,
        'profile': str(options.output),
    }
    return Answer(content, proposal_text(content))


def assumed_sizes(names: Sequence[str], model: ThermalModel, sensor: str) -> list[str]:
    """Return how large each effect is taken to be: as the model has it, else of a usual size."""
    part = model.sensors.get(sensor)
    known = {effect.name for effect in part.effects} if part else set()
    usual = 'M = 1: the standard deviation of a one-second mean (the model does not have it)'
    return [f'{name}: {"as the model has it" if name in known else usual}' for name in names]


def proposal_text(content: dict[str, Any]) -> str:
    """Return the proposal as lines."""
    one, other = content['effects']
    verdict = 'separable' if content['separable'] else 'not separable by temperature alone'
    before, after = content['evidence_before'], content['evidence_after']
    needed = f'; {content["evidence_needed"]:.0f} needed'
    lines = [
        f'{one} or {other} in the {content["sensor"]}: {verdict}',
        f'  evidence {before:.1f} with the plan of the paper, {after:.1f} with this one{needed}',
        '  (it grows with the square of the size: half as large an effect gives a quarter of it)',
        *(f'  assumed size of {line}' for line in content['assumed']),
        f'  {content["repeats"]} cycles, {content["hours"]:.1f} h a run: {content["profile"]}',
    ]
    return '\n'.join([*lines, *(f'  do: {action}' for action in content['actions'])])
