# SPDX-License-Identifier: Apache-2.0
"""Turn a CSV file into a bag."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.plausibility import admitted
from imu_recording.tables.csv_import import import_csv
from imu_recording.tables.mapping import UNIT_OF_FIELD
from thermal_comp.presentation.display import duration, shown

from imu_recording import ImuRecording, write_bag
from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_accept_argument,
    add_output_argument,
    claim_output,
    replacing,
)

HELP = 'Turn a CSV file into a bag; a YAML file maps columns to channels, scales, units, offsets.'
EPILOG = (
    'example:\n  python -m imu_workbench import Tempdata01-02-14.csv '
    '--mapping examples/freeimu_mapping.yaml -o freeimu'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('csv', metavar='CSV', type=Path, help='file to read')
    parser.add_argument(
        '--mapping', metavar='YAML', type=Path, required=True, help='what its columns are'
    )
    add_output_argument(parser, 'DIR', 'bag to write')
    add_accept_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Read, write, say what was dropped."""
    claim_output(options.output, force=options.force, folder=True)
    show_progress(f'reading {options.csv} …')
    recording = admitted(import_csv(options.csv, options.mapping), options.accept)
    channels = channel_ranges(recording)
    with replacing(options.output) as fresh:
        write_bag(recording, fresh)
    seconds = float(recording.time[-1]) if len(recording) else 0.0
    content = {
        'schema': 1,
        'output': options.output,
        'device': recording.device,
        'samples': len(recording),
        'duration_s': seconds,
        'channels': channels,
        'notes': recording.notes,
    }
    rate = shown((len(recording) - 1) / seconds) if seconds else '–'
    said = f'{len(recording)} samples, {duration(seconds)}, {rate} Hz on average'
    lines = [f'wrote {options.output}: {said}', *ranges_text(channels)]
    lines += [f'  note: {note}' for note in recording.notes]
    return Answer(content, '\n'.join(lines))


def channel_ranges(recording: ImuRecording) -> list[dict[str, Any]]:
    """Return least, mean and greatest value of every channel in its unit, NaN left out."""
    rows = []
    for field, unit in UNIT_OF_FIELD.items():
        values = getattr(recording, field)
        if values is None:
            continue
        columns = values.reshape(len(values), -1).T
        for axis, column in zip('xyz' if len(columns) == 3 else ' ', columns, strict=True):
            known = column[np.isfinite(column)]
            if len(known):
                size = {'min': known.min(), 'mean': known.mean(), 'max': known.max()}
                rows.append({'channel': f'{field} {axis}'.strip(), **size, 'unit': unit})
    return rows


def ranges_text(channels: list[dict[str, Any]]) -> list[str]:
    """Return the table of the ranges as lines."""
    lines = [f'  {"channel":<24}{"min":>12}{"mean":>12}{"max":>12}  unit']
    for row in channels:
        numbers = ''.join(f'{shown(row[key]):>12}' for key in ('min', 'mean', 'max'))
        lines.append(f'  {row["channel"]:<24}{numbers}  {row["unit"]}')
    return lines
