# SPDX-License-Identifier: Apache-2.0
"""Fit the linear thermal model of one device and save it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from thermal_comp.compare import compare_prepared
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fit import fit_prepared
from thermal_comp.model_file import save_model
from thermal_comp.preparation import prepare

from imu_workbench.answer import Answer
from imu_workbench.commands.options import add_bag_arguments, read_recordings
from imu_workbench.comparison_text import comparison_text
from imu_workbench.display import DISPLAY_UNITS, SENSORS, shown
from imu_workbench.pooling import Pooling, compare_pooling
from imu_workbench.progress import show_progress

HELP = 'Fit a line per axis against die temperature to the runs of one device; save the model.'
EPILOG = 'example:\n  python -m imu_workbench fit bags/dut1_? -o dut1.yaml --json dut1.json'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_bag_arguments(parser)
    parser.add_argument(
        '--pooled',
        action='store_true',
        help='one model for several devices, tested against a model for each',
    )
    parser.add_argument(
        '-o', '--output', metavar='MODEL', type=Path, required=True, help='model file to write'
    )


def run(options: argparse.Namespace) -> Answer:
    """Fit, compare, save."""
    recordings = read_recordings(options)
    show_progress('fitting …')
    runs = prepare(recordings)
    model = fit_prepared([BiasTemperature()], runs, pooled=options.pooled)
    save_model(model, options.output)
    comparison = compare_prepared(model, runs)
    content: dict[str, Any] = comparison.content() | {'model': str(options.output)}
    text = [comparison_text(content), *(f'note: {note}' for note in model.provenance.notes)]
    pooling = compare_pooling(runs, model) if options.pooled else []
    if pooling:
        content['pooling'] = [vars(row) for row in pooling]
        text += ['', pooling_text(pooling)]
    text.append(f'saved {options.output}')
    return Answer(content, '\n'.join(text))


def pooling_text(rows: Sequence[Pooling]) -> str:
    """Return the paper's argument against pooling as a table."""
    lines = ['Pooling: residual rms, a model for each device → one for all (slopes per K)']
    for row in sorted(rows, key=lambda row: SENSORS.index(row.sensor)):
        unit = DISPLAY_UNITS[row.sensor]
        for i, axis in enumerate('xyz'):
            slopes = ', '.join(
                f'{name} {shown(slope[i] * unit.factor)}' for name, slope in row.slopes.items()
            )
            sign = 'opposite signs' if row.opposite[i] else 'same sign'
            each = shown(row.individual_rms[i] * unit.factor)
            together = shown(row.pooled_rms[i] * unit.factor)
            lines.append(
                f'  {row.sensor:<14}{axis}  {sign:<15}{each:>9} → {together:>9} {unit.unit:<5} '
                f'({slopes})'
            )
    count = int(sum(row.opposite.sum() for row in rows))
    verdict = 'one model cannot hold for all' if count else 'signs do not speak against pooling'
    lines.append(f'  {count} of {3 * len(rows)} channels have slopes of opposite sign: {verdict}')
    return '\n'.join(lines)

