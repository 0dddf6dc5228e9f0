# SPDX-License-Identifier: Apache-2.0
"""Turn CSV files or the log of an autopilot into bags."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from imu_recording.logs.import_log import import_log, is_log
from imu_recording.plausibility import admitted
from imu_recording.tables.csv_import import import_csv
from imu_recording.tables.guess import Guess, guess_mapping
from imu_recording.tables.mapping import (
    UNIT_OF_FIELD,
    CsvMapping,
    mapping_from,
    mappings_in,
)
from imu_recording.tables.row_range import RowRange, row_range
from imu_recording.user_error import UserError
from thermal_comp.presentation.display import duration, shown

from imu_recording import ImuRecording, write_bag
from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import add_accept_argument, add_output_argument
from imu_workbench.outputs import claim_output, replacing

HELP = 'Turn CSV files, a PX4 ULog or an ArduPilot DataFlash log into bags.'
EPILOG = (
    'A YAML file maps the columns of a CSV to channels, scales, units, offsets; without one, a\n'
    'mapping is guessed from header and ranges and printed, with what is unsure. Further CSV\n'
    'files, such as the log of a chamber, are joined to the rows of the first by time: a mapping\n'
    'for each, or one file with --- between them; "start", "offset" or "zone" of time in a\n'
    'mapping say how its clock stands to the others. Of a log, every\n'
    'IMU that has a temperature becomes a bag, DIR/imu0, DIR/imu1, …, in the axes of the\n'
    'autopilot (forward-right-down).\n'
    'examples:\n'
    '  python -m imu_workbench import board.csv > mapping.yaml\n'
    '  python -m imu_workbench import board.csv --mapping examples/freeimu_mapping.yaml -o board\n'
    '  python -m imu_workbench import board.csv chamber.csv > both.yaml\n'
    '  python -m imu_workbench import board.csv chamber.csv --mapping both.yaml -o board\n'
    '  python -m imu_workbench import warmup.ulg -o warmup'
)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'files',
        metavar='FILE',
        type=Path,
        nargs='+',
        help='CSV (further ones are joined to it by time), .ulg or .bin',
    )
    parser.add_argument(
        '--mapping',
        metavar='YAML',
        type=Path,
        action='append',
        help='what the columns of a CSV are, one a file; without it a guess is printed',
    )
    parser.add_argument('--yes', action='store_true', help='import CSV files with the guess')
    parser.add_argument(
        '--device', metavar='NAME', help='name of the device; else that of the mapping or file'
    )
    for flag, name in (('--from', 'first'), ('--to', 'last')):
        parser.add_argument(
            flag,
            dest=name,
            metavar='WHERE',
            help='line of the CSV (1200), or time since the first sample (90s, 5min, 2h)',
        )
    what = 'bag to write; of a log, the folder of its bags'
    add_output_argument(parser, 'DIR', what, required=False)
    add_accept_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Read, write, say what was dropped."""
    for path in options.files:
        if not path.is_file():
            raise UserError(f'{path}: no such file')
    logs = [path for path in options.files if is_log(path)]
    if logs and len(options.files) > 1:
        raise UserError(f'{logs[0]} is a log: import it alone')
    if not logs and options.mapping is None and not options.yes:
        return _guessed(options.files)
    if options.output is None:
        raise UserError('-o DIR is missing: where to write')
    rows = row_range(options.first, options.last)
    return _import_log(options, rows) if logs else _import_csv(options, rows)


def _guesses(paths: Sequence[Path]) -> list[Guess]:
    return [guess_mapping(path, beside=k > 0) for k, path in enumerate(paths)]


def _guessed(paths: Sequence[Path]) -> Answer:
    """Say what the mappings would probably be, and what to check in them."""
    texts = []
    guesses = _guesses(paths)
    for path, guess in zip(paths, guesses, strict=True):
        lines = [
            f'# {path}: nothing is written; this mapping is a guess. Save it, correct it and give',
            '# it as --mapping, or take it as it is with --yes.',
            *(f'# unsure: {question}' for question in guess.unsure),
        ]
        text = yaml.safe_dump(
            guess.mapping, sort_keys=False, allow_unicode=True, default_flow_style=None
        )
        texts.append('\n'.join([*lines, text.rstrip()]))
    return Answer({'schema': 1, **_guess_content(guesses), 'output': None}, '\n---\n'.join(texts))


def _guess_content(guesses: Sequence[Guess]) -> dict[str, Any]:
    first, *others = guesses
    content: dict[str, Any] = {'mapping': first.mapping, 'unsure': first.unsure}
    if others:
        content['joined'] = [{'mapping': g.mapping, 'unsure': g.unsure} for g in others]
    return content


def _import_csv(options: argparse.Namespace, rows: RowRange) -> Answer:
    claim_output(options.output, force=options.force, folder=True)
    first, *others = options.files
    guesses = [] if options.mapping else _guesses(options.files)
    mappings: list[Any] = [guess.mapping for guess in guesses] or _mappings(options)
    show_progress(f'reading {", ".join(map(str, options.files))} …')
    beside = list(zip(others, mappings[1:], strict=True))
    recording = admitted(import_csv(first, mappings[0], rows, beside=beside), options.accept)
    if guesses:
        unsure = (f'guessed: {question}' for guess in guesses for question in guess.unsure)
        recording = recording.with_notes('the mapping is a guess', *unsure)
    recording = _named(recording, options.device)
    with replacing(options.output) as fresh:
        write_bag(recording, fresh)
    content, lines = _bag_description(recording, options.output)
    if guesses:
        content |= _guess_content(guesses)
    return Answer({'schema': 1, **content}, '\n'.join(lines))


def _mappings(options: argparse.Namespace) -> list[CsvMapping]:
    """Return the mapping of every file, in their order."""
    found = [(path, content) for path in options.mapping for content in mappings_in(path)]
    if len(found) != len(options.files):
        raise UserError(
            f'{len(options.files)} files and {len(found)} mappings: give one for each, in the '
            'same order, or a file of them with --- between'
        )
    return [
        mapping_from(content, str(path), beside=k > 0) for k, (path, content) in enumerate(found)
    ]


def _import_log(options: argparse.Namespace, rows: RowRange) -> Answer:
    (file,) = options.files
    if options.mapping is not None:
        raise UserError(f'--mapping: {file} is a log, which needs none')
    if rows.by_line:
        raise UserError(f'{file} is a log: give --from and --to as times, such as 90s')
    show_progress(f'reading {file} …')
    imus = [
        (imu, admitted(_part(imu.recording, rows), options.accept), options.output / imu.name)
        for imu in import_log(file)
    ]
    for _, _, target in imus:
        claim_output(target, force=options.force, folder=True)
    bags, lines = [], []
    for imu, recording, target in imus:
        number = f'_{imu.name}' if len(imus) > 1 else ''
        named = _named(recording, options.device and options.device + number)
        with replacing(target) as fresh:
            write_bag(named, fresh, metadata=imu.metadata)
        content, said = _bag_description(named, target)
        hardware = json.loads(imu.metadata['log_hardware'])
        bags.append(content | {'hardware': hardware})
        lines += [*said, *(f'  {name}: {value}' for name, value in hardware.items() if value)]
    return Answer({'schema': 1, 'log': file, 'bags': bags}, '\n'.join(lines))


def _named(recording: ImuRecording, device: str | None) -> ImuRecording:
    return replace(recording, device=device) if device else recording


def _part(recording: ImuRecording, rows: RowRange) -> ImuRecording:
    inside = rows.within(recording.stamp)
    if inside.all():
        return recording
    if not inside.any():
        raise UserError(f'{recording.source}: no sample between --from and --to')
    left_out = f'{int((~inside).sum())} rows outside --from and --to left out'
    return recording.rows(inside).with_notes(left_out)


def _bag_description(recording: ImuRecording, target: Path) -> tuple[dict[str, Any], list[str]]:
    """Return the description of one bag, for JSON and as lines."""
    channels = channel_ranges(recording)
    seconds = float(recording.time[-1]) if len(recording) else 0.0
    content = {
        'output': target,
        'device': recording.device,
        'samples': len(recording),
        'duration_s': seconds,
        'channels': channels,
        'notes': recording.notes,
    }
    rate = shown((len(recording) - 1) / seconds) if seconds else '–'
    said = f'{len(recording)} samples, {duration(seconds)}, {rate} Hz on average'
    lines = [f'wrote {target}: {said}', *ranges_text(channels)]
    return content, [*lines, *(f'  note: {note}' for note in recording.notes)]


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
