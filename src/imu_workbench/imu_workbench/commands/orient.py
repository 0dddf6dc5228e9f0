# SPDX-License-Identifier: Apache-2.0
"""How many degrees each sensor's temperature error costs each filter."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from imu_recording.recording import ImuRecording
from imu_recording.user_error import UserError
from orientation_filters.filters import FILTERS
from orientation_filters.parameters import PRESET_NAMES, WORLD_FRAMES
from thermal_comp.compensation.stream import compensate
from thermal_comp.model.file import check_device, load_model
from thermal_comp.presentation.display import FILTER_LABELS

from imu_workbench.answer import Answer, show_progress
from imu_workbench.attitude_budget import Attribution, Cost, attribute, content_of, remarks
from imu_workbench.commands.options import add_bag_arguments, stream_recordings

HELP = 'Orientation raw, compensated, and with one sensor compensated at a time.'
EPILOG = (
    'Errors are against reference/orientation where the bag has it, else against the run with\n'
    'all sensors compensated. gained: error taken away by a compensation; moved: angle between\n'
    'that run and the raw one, which is what the temperature error did to the attitude.\n'
    'Bags slower than 50 Hz are interpolated, which is said.\n'
    'example:\n  python -m imu_workbench orient bags/dut1_motion --model dut1.yaml --json out.json'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    parser.add_argument(
        '--model', metavar='MODEL', type=Path, required=True, help='model file of `fit`'
    )
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
    parser.add_argument('--six-axis', action='store_true', help='do not use the magnetometer')


def run(options: argparse.Namespace) -> Answer:
    """Attribute every bag."""
    model = load_model(options.model)
    bags, texts = [], []
    for recording in stream_recordings(options):
        if not model.pooled:
            check_device(model, recording.device)
        result = attribute(
            recording,
            compensate(recording, model),
            filters=options.filters or tuple(FILTERS),
            presets=options.preset or PRESET_NAMES,
            progress=show_progress,
            world_frame=options.world_frame,
            use_magnetometer=not options.six_axis,
        )
        if not any(math.isfinite(cost.rms['total']) for cost in result.costs):
            raise UserError(
                f'{recording.source}: no attitude: no row has finite angular_velocity and '
                'linear_acceleration'
            )
        bags.append(content_of(result, recording))
        texts.append(text_of(result, recording))
    show_progress('')
    content = {'schema': 1, 'model': options.model, 'unit': 'deg', 'bags': bags}
    return Answer(content, '\n\n'.join(texts))


def text_of(result: Attribution, recording: ImuRecording) -> str:
    """Return the attribution as the terminal shows it."""
    name = recording.source or recording.run or recording.device
    lines = [f'{name}: rms error [°] against the {result.against}']
    lines += [f'  note: {note}' for note in result.recording.notes]
    lines += ['', f'{"":46}{"total":>9}{"heading":>9}{"inclin.":>9}{"gained":>9}{"moved":>9}']
    lines += [_row(f'{_label(c.filter)} {c.preset}, {c.data}', c) for c in result.costs]
    lines += ['', 'complementary over its cut-off:']
    lines += [_row(f'{c.cutoff_hz:g} Hz, {c.data}', c) for c in result.sweep]
    lines += ['', f'{"":46}{"ns/sample":>11}{"state [B]":>11}']
    lines += [
        f'{_label(e.filter) + " " + e.preset:46}'
        f'{e.nanoseconds_per_sample:11.0f}{e.state_bytes:11d}'
        for e in result.efforts
    ]
    lines += ['', "the paper's remarks:"]
    for row in remarks(result):
        ours = ', '.join(f'{_label(k)} {v:.3g} {row["unit"]}' for k, v in row['ours'].items())
        lines.append(f'  {row["remark"]}: {"yes" if row["holds"] else "no"} ({ours})')
    return '\n'.join(lines)


def _label(name: str) -> str:
    return FILTER_LABELS.get(name, name)


def _row(label: str, cost: Cost) -> str:
    kinds = ''.join(f'{cost.rms[kind]:9.3f}' for kind in ('total', 'heading', 'inclination'))
    return f'{label:46}{kinds}{cost.gain["total"]:9.3f}{cost.moved["total"]:9.3f}'
