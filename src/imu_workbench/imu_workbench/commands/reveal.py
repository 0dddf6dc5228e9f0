# SPDX-License-Identifier: Apache-2.0
"""Diagnose a campaign with a hidden effect, then compare with the truth."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from thermal_comp.diagnosis.diagnose import diagnose

from imu_recording import read_bag
from imu_workbench.answer import Answer
from imu_workbench.motion_detection import with_motion_noted
from imu_workbench.simulate.hidden_effect import (
    VERDICTS,
    describe_truth,
    find_truth,
    score_diagnosis,
)

HELP = 'Diagnose a campaign of `simulate --hide`, then open the truth and compare.'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'folder', type=Path, metavar='DIR', help='the folder `simulate … --hide` wrote'
    )


def run(options: argparse.Namespace) -> Answer:
    """Diagnose first, then look."""
    bags = find_truth(options.folder)[1]
    diagnosis = diagnose(with_motion_noted(read_bag(bag)) for bag in bags).to_dict()
    truth = find_truth(options.folder)[0]
    score = score_diagnosis(truth, diagnosis)
    reported = '; '.join(score.reported) or 'nothing'
    verdict = VERDICTS[score.outcome]
    if score.outcome in ('named', 'in_set') and not score.sensor_right:
        verdict += ', but in the wrong sensor'
    if truth['kind'] == 'nothing':
        verdict = 'right: no alarm' if score.right else 'wrong: nothing was hidden'
    content: dict[str, Any] = {
        'schema': 1,
        'truth': truth,
        **asdict(score),
        'right': score.right,
        'diagnosis': diagnosis,
    }
    text = f'hidden:   {describe_truth(truth)}\nreported: {reported}\n{verdict}'
    return Answer(content, text)
