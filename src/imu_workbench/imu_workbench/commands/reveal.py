# SPDX-License-Identifier: Apache-2.0
"""Diagnose a campaign with a hidden effect, then compare with the truth."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from imu_driver.simulation.hidden import HIDEABLE
from imu_recording.plausibility import admitted
from imu_recording.user_error import UserError
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects.effect import Effect
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import check_device, load_model
from thermal_comp.model.values import ThermalModel

from imu_recording import ImuRecording, read_bag
from imu_workbench.answer import Answer
from imu_workbench.commands.options import add_effects_argument, add_model_argument
from imu_workbench.fleet import require_fleet
from imu_workbench.simulate.fleet import fleet_truth, score_fleet
from imu_workbench.simulate.hidden_effect import (
    all_hidden,
    describe_changes,
    describe_truth,
    find_truth,
)
from imu_workbench.simulate.score import VERDICTS, Score, describe, score_each

HELP = 'Diagnose a campaign of `simulate --hide`, then open the truth and compare.'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'folder',
        type=Path,
        metavar='DIR',
        help='the folder `simulate … --hide` or `--fleet` wrote',
    )
    add_model_argument(parser, 'model of an earlier campaign, for what `simulate … --aged` wrote')
    parser.add_argument(
        '--fleet', type=Path, metavar='DIR', help='results of `fleet`, for a simulated fleet'
    )
    add_effects_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Diagnose first, then look."""
    population = fleet_truth(options.folder)
    if population is not None:
        return _fleet(population, options.fleet, effect_catalogue(options.effects))
    if options.fleet:
        raise UserError(f'{options.folder}: no fleet was simulated here; leave --fleet away')
    truth, bags = find_truth(options.folder)
    catalogue = effect_catalogue(options.effects)
    if any(one['law'] not in {*HIDEABLE, *catalogue} for one in all_hidden(truth)):
        raise UserError(
            f"{options.folder}: an effect of a user's own is hidden: give its file with --effects"
        )
    model = load_model(options.model, catalogue) if options.model else None
    found = diagnose(_recordings(bags, model), model, catalogue=catalogue)
    diagnosis = found.to_dict()
    truths = all_hidden(truth)
    scores = score_each(truths, diagnosis)
    content: dict[str, Any] = {
        'schema': 1,
        'truth': truth,
        **asdict(scores[0]),
        'reported': [describe(finding) for finding in diagnosis['findings']],
        'right': all(score.right for score in scores),
        'outcomes': [
            {'name': one['law'], **asdict(score), 'right': score.right}
            for one, score in zip(truths, scores, strict=True)
        ],
        'diagnosis': diagnosis,
    }
    lines = []
    for one, score in zip(truths, scores, strict=True):
        lines += [f'hidden:   {describe_truth(one)}', f'          {_verdict(one, score)}']
    if 'changes' in truth:
        lines += [f'changed:  {line}' for line in describe_changes(truth['changes'])]
    reported = '; '.join(content['reported']) or 'nothing'
    lines.append(f'reported: {reported} (verdict: {diagnosis["verdict"]})')
    return Answer(content, '\n'.join(lines))


def _fleet(
    truth: Mapping[str, Any], results: Path | None, catalogue: Mapping[str, type[Effect]]
) -> Answer:
    """Tell what the lots of a simulated fleet are made of, which devices are odd, what was found.

    The study of the results comes first.
    """
    content: dict[str, Any] = {'schema': 1}
    if results:
        require_fleet()
        from imu_workbench.fleet.study import study

        content['score'] = score_fleet(study(results, catalogue=catalogue), truth)
    lines = [f'{len(truth["devices"])} devices of {len(truth["lots"])} lots']
    for lot, drawn in truth['lots'].items():
        common = '; '.join(
            f'{effect["name"]} in {effect["sensor"]} of {100 * effect["prevalence"]:.0f} %'
            for effect in drawn['effects']
            if effect['prevalence']
        )
        lines.append(f'lot {lot}: {common or "nothing hidden in many"}')
    odd = {name: one['outlier'] for name, one in truth['devices'].items() if one['outlier']}
    lines += [f'outlier {name}: {what}' for name, what in odd.items()]
    if results:
        lines += content['score']['lines']
    return Answer({**content, 'truth': truth, 'outliers': odd}, '\n'.join(lines))


def _recordings(bags: Sequence[Path], model: ThermalModel | None) -> Iterator[ImuRecording]:
    for bag in bags:
        recording = admitted(read_bag(bag), sensors=False)
        check_device(model, recording.device)
        yield recording


def _verdict(truth: Mapping[str, Any], score: Score) -> str:
    if truth['kind'] == 'nothing':
        return 'right: no alarm' if score.right else 'wrong: nothing was hidden'
    if score.outcome in ('named', 'in_set') and not score.sensor_right:
        return f'{VERDICTS[score.outcome]}, but in the wrong sensor'
    return VERDICTS[score.outcome]
