# SPDX-License-Identifier: Apache-2.0
"""Write a thermal model in a form that other software reads."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray
from imu_recording.user_error import UserError
from thermal_comp.data.conditions import INERTIAL_SENSORS, Sensor
from thermal_comp.data.preparation import prepare
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.export.ardupilot import SENSOR_NAMES, ardupilot_text
from thermal_comp.export.c99 import C99_FILES, c99_of
from thermal_comp.export.cubic import RATE_C_PER_MIN, Cubic, fitted_cubic, loss, reduced
from thermal_comp.export.kalibr import HORIZON_S, densities, kalibr_text
from thermal_comp.export.px4 import INSTANCES, SENSOR_LETTERS, px4_text
from thermal_comp.export.single_precision import LARGEST_ROUNDING_SHARE, single_precision_shares
from thermal_comp.export.vectors import example_course, recorded_course, vectors_text
from thermal_comp.model.file import load_model, model_label
from thermal_comp.model.values import ThermalModel
from thermal_comp.presentation.display import DISPLAY_UNITS, shown

from imu_recording import ImuRecording
from imu_workbench.answer import Answer, show_progress
from imu_workbench.commands.options import (
    add_bag_arguments,
    add_effects_argument,
    add_output_argument,
    read_recordings,
)
from imu_workbench.outputs import claim_output

HELP = (
    'Write a model as C99, PX4 or ArduPilot parameters, or the noise for Kalibr; say what is lost.'
)
EPILOG = (
    'PX4 and ArduPilot take a polynomial of third order: with bags it is fitted to them, and its\n'
    'held-out error stands beside that of the whole model; without, it is the one nearest to the\n'
    'model in ramps of 2 K/min. Axes are those of the recordings the model was fitted to: the\n'
    'bags of `import LOG` have those of the autopilot.\n'
    'example:\n'
    '  python -m imu_workbench export better.yaml --to c99 -o thermal\n'
    '  make -C firmware test THERMAL=$PWD/thermal\n'
    '  python -m imu_workbench export better.yaml bags/hidden_effect_? --to px4 -o board.params'
)
VECTORS_FILE = 'imu_thermal_vectors.txt'


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('model', metavar='MODEL', type=Path, help='model file')
    add_bag_arguments(parser, optional=True)
    parser.add_argument('--to', choices=tuple(FORMS), required=True, help='form to write')
    parser.add_argument(
        '--instance',
        metavar='N',
        type=int,
        choices=INSTANCES,
        default=0,
        help='IMU of the autopilot, counted from 0 (%(default)s): TC_A0_… , INS_TCAL1_…',
    )
    parser.add_argument(
        '--accel-id', metavar='ID', type=int, help='device ID of the accelerometer (CAL_ACC0_ID)'
    )
    parser.add_argument(
        '--gyro-id', metavar='ID', type=int, help='device ID of the gyroscope (CAL_GYRO0_ID)'
    )
    parser.add_argument(
        '--rate',
        metavar='HZ',
        type=float,
        default=100.0,
        help='rate of the topic, for kalibr (%(default)g)',
    )
    parser.add_argument(
        '--rostopic',
        metavar='NAME',
        default='/imu/data_raw',
        help='topic, for kalibr (%(default)s)',
    )
    add_effects_argument(parser)
    add_output_argument(parser, 'OUT', 'file to write; for c99 a folder to write into')


def run(options: argparse.Namespace) -> Answer:
    """Read, write, say what was written and what is lost."""
    if options.to == 'c99':
        claim_files(options.output, force=options.force)
    else:
        claim_output(options.output, force=options.force)
    model = load_model(options.model, effect_catalogue(options.effects))
    return FORMS[options.to](model, read_recordings(options, model=model), options)


def _c99(
    model: ThermalModel, recordings: list[ImuRecording], options: argparse.Namespace
) -> Answer:
    exported = c99_of(model)
    show_progress('computing test vectors …')
    courses = [recorded_course(model, recording) for recording in recordings]
    courses = courses or [example_course(model)]
    vectors = vectors_text(model, exported.channels, courses)
    write_files(options.output, {**exported.files, VECTORS_FILE: vectors})
    effects = {
        sensor: [effect.name for _, effect, _ in part.device_terms()]
        for sensor, part in model.sensors.items()
    }
    content: dict[str, Any] = {
        'schema': 1,
        'model': options.model,
        'to': options.to,
        'output': options.output,
        'files': [*exported.files, VECTORS_FILE],
        'effects': effects,
        'channels': dict(exported.channels),
        'vectors': vectors.count('\n') - 1,
        'single_precision': single_precision_shares(model, courses),
    }
    lines = [f'wrote {options.output}: {", ".join(content["files"])}']
    lines += [f'  {sensor}: {", ".join(names) or "nothing"}' for sensor, names in effects.items()]
    if exported.channels:
        lines.append(f'  the board has to supply: {", ".join(exported.channels)}')
    lines += _precision_lines(content['single_precision'])
    lines.append(f'check it: make -C firmware test THERMAL={options.output.resolve()}')
    return Answer(content, '\n'.join(lines))


def _precision_lines(shares: Mapping[Sensor, float]) -> list[str]:
    """Return which sensors single precision is too coarse for, and what to do."""
    coarse = {sensor: share for sensor, share in shares.items() if share > LARGEST_ROUNDING_SHARE}
    lines = [
        f'  {sensor}: off by about {share:.0e} of the correction in single precision '
        f'({LARGEST_ROUNDING_SHARE:.0e} is wanted): its effects nearly cancel each other'
        for sensor, share in coarse.items()
    ]
    if coarse:
        lines.append(
            '  define IMU_THERMAL_DOUBLE where it is compiled, or leave one of them out of the '
            'model; `make test` fails in single precision'
        )
    return lines


def claim_files(folder: Path, *, force: bool) -> None:
    """Refuse to write the C form where one of its files exists, unless `force`."""
    if folder.exists() and not folder.is_dir():
        raise UserError(f'{folder} is a file: choose another -o')
    for name in () if force else (*C99_FILES, VECTORS_FILE):
        if (folder / name).exists():
            raise UserError(
                f'{folder / name} exists already: choose another -o, or replace it with --force'
            )


def write_files(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder, which is made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, 'utf-8')


def _autopilot(
    model: ThermalModel, recordings: list[ImuRecording], options: argparse.Namespace
) -> Answer:
    px4 = options.to == 'px4'
    known = [
        sensor for sensor in (SENSOR_LETTERS if px4 else SENSOR_NAMES) if sensor in model.sensors
    ]
    if not known:
        raise UserError(f'{options.model}: neither accelerometer nor gyroscope: nothing to export')
    held_out: Mapping[Sensor, tuple[FloatArray, FloatArray]] = {}
    if recordings:
        show_progress('fitting the polynomial …')
        fitted, held_out = fitted_cubic(model, prepare(recordings))
        cubics = {sensor: fitted[sensor] for sensor in known if sensor in fitted}
    else:
        cubics = {sensor: reduced(model, sensor) for sensor in known}
    label = model_label(model)
    given = {'accelerometer': options.accel_id, 'gyroscope': options.gyro_id}
    ids = {s: given[s] for s in known if given[s] is not None}
    text = (
        px4_text(cubics, options.instance, ids, label)
        if px4
        else ardupilot_text(cubics, options.instance, label)
    )
    options.output.write_text(text, 'utf-8')
    rows = {s: _what_is_lost(model, s, cubic, held_out.get(s)) for s, cubic in cubics.items()}
    content = {'schema': 1, 'model': options.model, 'to': options.to, 'output': options.output}
    content |= {'instance': options.instance, 'sensors': rows}
    lines = [f'wrote {options.output}: {len(text.splitlines())} lines']
    lines += [line for s, row in rows.items() for line in _loss_lines(s, row)]
    left_out = [s for s in model.sensors if s not in cubics]
    lines += [f'  {s}: not exported, it keeps all of its error' for s in left_out]
    lines += _to_do(options, known, ids)
    return Answer(content, '\n'.join(lines))


def _what_is_lost(
    model: ThermalModel,
    sensor: Sensor,
    cubic: Cubic,
    held_out: tuple[FloatArray, FloatArray] | None,
) -> dict[str, Any]:
    lost = loss(model, sensor, cubic)
    row: dict[str, Any] = {
        'unit': SENSOR_UNITS[sensor],
        'coefficients': cubic.coefficients,
        'reference_temperature': cubic.reference,
        'temperature_range': [cubic.low, cubic.high],
        'kept': lost.kept,
        'costs': dict(lost.costs),
        'not_followed': list(lost.not_followed),
    }
    if held_out:
        row |= {'held_out_cubic': held_out[0], 'held_out_model': held_out[1]}
    return row


def _loss_lines(sensor: Sensor, row: Mapping[str, Any]) -> list[str]:
    display = DISPLAY_UNITS[sensor]
    kept = f'keeps {100.0 * row["kept"]:.0f} % of the correction'
    lines = [f'  {sensor}: the cubic {kept} in ramps of {RATE_C_PER_MIN:g} K/min']
    for effect, cost in row['costs'].items():
        why = 'is not followed, rms' if effect in row['not_followed'] else 'costs up to'
        lines.append(f'    {effect} {why} {shown(cost * display.factor)} {display.unit}')
    if 'held_out_cubic' in row:
        cubic, whole = (
            ' '.join(shown(v) for v in display.of(np.asarray(row[key])))
            for key in ('held_out_cubic', 'held_out_model')
        )
        errors = f'cubic {cubic}, whole model {whole} {display.unit}'
        lines.append(f'    held out in the recordings (x y z): {errors}')
    return lines


def _to_do(
    options: argparse.Namespace, known: list[Sensor], ids: Mapping[Sensor, int]
) -> list[str]:
    """Return what the autopilot needs beside the file."""
    lines = ['load it, reboot, then calibrate the offsets anew: they hold at one temperature']
    flags = {'accelerometer': '--accel-id', 'gyroscope': '--gyro-id'}
    missing = [
        f'TC_{SENSOR_LETTERS[s]}{options.instance}_ID ({flags[s]})' for s in known if s not in ids
    ]
    if options.to == 'px4' and missing:
        lines.append(
            f'not in the file: {", ".join(missing)}; PX4 applies nothing until the ID is that of '
            'the sensor'
        )
    return lines


def _kalibr(
    model: ThermalModel, _recordings: list[ImuRecording], options: argparse.Namespace
) -> Answer:
    if not options.rate > 0.0:
        raise UserError(f'--rate {options.rate:g}: expected a positive number')
    text = kalibr_text(model, options.rate, options.rostopic, model_label(model))
    options.output.write_text(text, 'utf-8')
    sensors = {}
    for sensor in INERTIAL_SENSORS:
        part = model.sensors[sensor]
        assert part.noise is not None  # noqa: S101 (kalibr_text refuses it)
        white, walk = densities(part.noise)
        sensors[sensor] = {'noise_density': white, 'random_walk': walk}
    content = {'schema': 1, 'model': options.model, 'to': 'kalibr', 'output': options.output}
    content |= {'update_rate': options.rate, 'horizon_s': HORIZON_S, 'sensors': sensors}
    lines = [
        f'wrote {options.output}: the worst axis of each sensor',
        f'  noise slower than {HORIZON_S:g} s counts as random walk, √(Σ 2σ²/τ)',
        '  faster noise as white, √(density² + Σ 2σ²τ)',
        f'  update_rate: {options.rate:g} Hz (--rate)',
        '  the temperature correction has no place in it: Kalibr wants data that are compensated',
    ]
    return Answer(content, '\n'.join(lines))


FORMS: dict[str, Callable[[ThermalModel, list[ImuRecording], argparse.Namespace], Answer]] = {
    'c99': _c99,
    'px4': _autopilot,
    'ardupilot': _autopilot,
    'kalibr': _kalibr,
}
"""Form → what writes it."""
