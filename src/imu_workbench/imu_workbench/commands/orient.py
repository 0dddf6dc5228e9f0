# SPDX-License-Identifier: Apache-2.0
"""How many degrees each sensor's temperature error costs each filter."""

from __future__ import annotations

import argparse
import math

from imu_recording.user_error import UserError
from orientation_filters.filters import FILTERS
from orientation_filters.parameters import PRESET_NAMES, WORLD_FRAMES
from thermal_comp.compensation.recording import compensate
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import load_model

from imu_workbench.answer import Answer, show_progress
from imu_workbench.attitude_budget import (
    attitude_budget,
    budget_content,
    budget_text,
    ten_minute_drift,
)
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_model_argument,
    stream_recordings,
)

HELP = 'Orientation raw, compensated, and with one sensor compensated at a time.'
EPILOG = (
    'Errors are against reference/orientation; a bag without it tells no error, only how far\n'
    'each run moved. gained: error taken away by a compensation; moved: angle between that run\n'
    'and the raw one, which is what the temperature error did to the attitude.\n'
    '--smooth adds the attitude known from all samples, before and after each row.\n'
    'Bags slower than 50 Hz are interpolated, which is said.\n'
    'example:\n  python -m imu_workbench orient bags/dut1_motion --model dut1.yaml --json out.json'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    add_effects_argument(parser)
    add_model_argument(parser, 'model file of `fit`', required=True)
    parser.add_argument(
        '--preset',
        action='append',
        choices=PRESET_NAMES,
        help='values of the filters; repeatable (default: both)',
    )
    parser.add_argument(
        '--filter',
        dest='filters',
        action='append',
        choices=tuple(FILTERS),
        help='filter to run; repeatable (default: both)',
    )
    parser.add_argument(
        '--world-frame', choices=WORLD_FRAMES, default='enu', help='axes of the world (enu)'
    )
    parser.add_argument(
        '--smooth',
        action='store_true',
        help='also the smoothed attitude, each filter forward and backward over the bag (robust)',
    )
    parser.add_argument('--six-axis', action='store_true', help='do not use the magnetometer')


def run(options: argparse.Namespace) -> Answer:
    """Estimate the attitudes of every bag and their errors."""
    model = load_model(options.model, effect_catalogue(options.effects))
    bags = []
    for recording in stream_recordings(options, model=model):
        compensated = compensate(recording, model, again='compensated' in options.accept)
        budget = attitude_budget(
            recording,
            compensated,
            filters=options.filters or tuple(FILTERS),
            presets=options.preset or PRESET_NAMES,
            progress=show_progress,
            smooth=options.smooth,
            world_frame=options.world_frame,
            use_magnetometer=not options.six_axis,
        )
        if not any(math.isfinite(cost.rms['total']) for cost in budget.costs):
            raise UserError(
                f'{recording.source}: no attitude: no row has finite angular_velocity and '
                'linear_acceleration'
            )
        drift = ten_minute_drift(recording, compensated, model)
        bags.append(budget_content(budget, recording, drift))
    show_progress('')
    content = {'schema': 1, 'model': options.model, 'unit': 'deg', 'bags': bags}
    return Answer(content, '\n\n'.join(map(budget_text, bags)))
