# SPDX-License-Identifier: Apache-2.0
"""Write a thermal model in a form that other software reads."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from imu_recording.user_error import UserError
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.export.c99 import c99_of
from thermal_comp.model.export.vectors import example_course, recorded_course, vectors_text
from thermal_comp.model.file import load_model
from thermal_comp.model.values import ThermalModel

from imu_recording import ImuRecording
from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_output_argument,
    read_recordings,
)

HELP = 'Write a model as C99.'
EPILOG = (
    'example:\n  python -m imu_workbench export better.yaml --to c99 -o thermal\n'
    '  make -C firmware test THERMAL=$PWD/thermal'
)
VECTORS = 'imu_thermal_vectors.txt'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('model', metavar='MODEL', type=Path, help='model file')
    add_bag_arguments(parser, optional=True)
    parser.add_argument('--to', choices=('c99',), required=True, help='form to write')
    add_effects_argument(parser)
    add_output_argument(parser, 'DIR', 'folder to write into')


def run(options: argparse.Namespace) -> Answer:
    """Read, write, say what was written."""
    model = load_model(options.model, effect_catalogue(options.effects))
    recordings = read_recordings(options, model=model)
    return _c99(model, recordings, options)


def _c99(
    model: ThermalModel, recordings: list[ImuRecording], options: argparse.Namespace
) -> Answer:
    exported = c99_of(model)
    claim_files(options.output, [*exported.files, VECTORS], force=options.force)
    show_progress('computing test vectors …')
    courses = [recorded_course(model, recording) for recording in recordings]
    vectors = vectors_text(model, exported.channels, courses or [example_course(model)])
    write_files(options.output, {**exported.files, VECTORS: vectors})
    effects = {
        sensor: [effect.name for _, effect, _ in part.device_terms()]
        for sensor, part in model.sensors.items()
    }
    content: dict[str, Any] = {
        'schema': 1,
        'model': options.model,
        'to': options.to,
        'output': options.output,
        'files': [*exported.files, VECTORS],
        'effects': effects,
        'channels': dict(exported.channels),
        'vectors': vectors.count('\n') - 1,
    }
    lines = [f'wrote {options.output}: {", ".join(content["files"])}']
    lines += [f'  {sensor}: {", ".join(names) or "nothing"}' for sensor, names in effects.items()]
    if exported.channels:
        lines.append(f'  the board has to supply: {", ".join(exported.channels)}')
    lines.append(f'check it: make -C firmware test THERMAL={options.output.resolve()}')
    return Answer(content, '\n'.join(lines))


def claim_files(folder: Path, names: list[str], *, force: bool) -> None:
    """Refuse to write files where one of them exists, unless `force`."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f'{folder} is a file: choose another -o')
    if force:
        return
    for name in names:
        if (folder / name).exists():
            raise UserError(
                f'{folder / name} exists already: choose another -o, or replace it with --force'
            )


def write_files(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, 'utf-8')
