# SPDX-License-Identifier: Apache-2.0
"""Turn a CSV file into a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from imu_recording.tables.csv_import import import_csv
from thermal_comp.presentation.display import duration, shown

from imu_recording import write_bag
from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import add_output_argument, claim_output

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


def run(options: argparse.Namespace) -> Answer:
    """Read, write, say what was dropped."""
    claim_output(options.output, force=options.force, folder=True)
    show_progress(f'reading {options.csv} …')
    recording = import_csv(options.csv, options.mapping)
    write_bag(recording, options.output)
    seconds = float(recording.time[-1]) if len(recording) else 0.0
    content = {
        'schema': 1,
        'output': options.output,
        'device': recording.device,
        'samples': len(recording),
        'duration_s': seconds,
        'notes': recording.notes,
    }
    rate = shown((len(recording) - 1) / seconds) if seconds else '–'
    said = f'{len(recording)} samples, {duration(seconds)}, {rate} Hz on average'
    lines = [f'wrote {options.output}: {said}', *(f'  note: {note}' for note in recording.notes)]
    return Answer(content, '\n'.join(lines))
