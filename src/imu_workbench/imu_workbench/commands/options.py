# SPDX-License-Identifier: Apache-2.0
"""Arguments that verbs share, and the recordings they name.

Modules that take a second to import are imported where they are used: `serve` starts its workers
before.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import yaml
from imu_recording.logging_contract import TRACK_OF_TOPIC
from imu_recording.user_error import UserError, did_you_mean, fault_in_yaml

from imu_workbench.answer import CHECK_FAILED, show_progress
from imu_workbench.bag_devices import read_devices

if TYPE_CHECKING:
    from thermal_comp.diagnosis.noise_level import NoiseReference
    from thermal_comp.effects.effect import Effect
    from thermal_comp.model.values import ThermalModel

    from imu_recording import ImuRecording

LEAST_TOLD_DISTANCE_K = 1.0
"""Distance of the reference temperature from what was recorded, from which a word is said."""


def add_bag_arguments(parser: argparse.ArgumentParser, *, optional: bool = False) -> None:
    """Add the positional bags with --namespace and --topic."""
    parser.add_argument(
        'bags',
        nargs='*' if optional else '+',
        metavar='BAG',
        type=Path,
        help='a rosbag2 folder or file (mcap, sqlite3), or a ROS 1 bag; one run each',
    )
    parser.add_argument(
        '--namespace', metavar='/NAME', help='the device to take where a bag holds several'
    )
    add_topic_arguments(parser)
    add_accept_argument(parser)


def add_topic_arguments(parser: argparse.ArgumentParser) -> None:
    """Add --topic and --topics, which name the topics of a bag that are read."""
    parser.add_argument(
        '--topic',
        metavar='NAME:=OTHER',
        action='append',
        default=[],
        help='read OTHER for NAME (imu/mag:=/compass), or nothing (imu/mag:=); repeatable',
    )
    parser.add_argument(
        '--topics',
        metavar='YAML',
        type=Path,
        help='file of such rules, one "NAME: OTHER" a line; --topic comes before it',
    )


def add_accept_argument(parser: argparse.ArgumentParser) -> None:
    """Add --accept, which takes what the checks of plausibility refuse."""
    from imu_recording.plausibility import ACCEPTABLE_DEFECTS

    parser.add_argument(
        '--accept',
        choices=ACCEPTABLE_DEFECTS,
        action='append',
        default=[],
        help='take implausible numbers, or data compensated before, as they are; repeatable',
    )


def add_effects_argument(parser: argparse.ArgumentParser) -> None:
    """Add --effects, which names files with effects of the user's own."""
    parser.add_argument(
        '--effects',
        metavar='FILE',
        type=Path,
        action='append',
        default=[],
        help='Python file with further effects; repeatable',
    )


def add_noise_reference_argument(parser: argparse.ArgumentParser) -> None:
    """Add --noise-reference, a chip or a model whose noise counts as normal."""
    from thermal_comp.diagnosis.noise_level import chip_references

    parser.add_argument(
        '--noise-reference',
        metavar='CHIP|MODEL',
        help=f'chip ({", ".join(chip_references())}) or model file whose noise counts as normal; '
        'else the LSM9DS1, which says nothing of another chip',
    )


def noise_reference(
    options: argparse.Namespace, catalogue: Mapping[str, type[Effect]]
) -> NoiseReference | None:
    """Return the noise that counts as normal; None: that of the shipped chip."""
    from thermal_comp.data.conditions import SENSORS
    from thermal_comp.diagnosis.noise_level import NoiseReference, chip_references
    from thermal_comp.model.file import load_model

    given = options.noise_reference
    if not given:
        return None
    chips = chip_references()
    name = given.lower().replace('-', '')
    if name in chips:
        return chips[name]
    if not Path(given).exists():
        near = did_you_mean(name, chips)
        raise UserError(
            f'--noise-reference {given}: neither a chip{near} nor a file; '
            f'known chips: {", ".join(chips)}'
        )
    known = load_model(Path(given), catalogue)
    sensors = ((s, known.sensors[s].noise) for s in SENSORS if s in known.sensors)
    found = {sensor: noise for sensor, noise in sensors if noise is not None}
    if not found:
        raise UserError(
            f'--noise-reference {given}: the model knows no noise; fit one to '
            'recordings of a unit that counts as normal'
        )
    return NoiseReference(known.device or Path(given).name, found)


def add_model_argument(
    parser: argparse.ArgumentParser, what: str, *, required: bool = False
) -> None:
    """Add --model; `what` says what it is for, and what happens without it."""
    parser.add_argument('--model', metavar='MODEL', type=Path, required=required, help=what)


def add_output_argument(
    parser: argparse.ArgumentParser, metavar: str, what: str, *, required: bool = True
) -> None:
    """Add -o, which most verbs that write cannot do without, and --force."""
    parser.add_argument('-o', '--output', metavar=metavar, type=Path, required=required, help=what)
    model = ', and save a model that held-out parts speak against' if metavar == 'MODEL' else ''
    parser.add_argument(
        '--force',
        action='store_true',
        help=f'replace what exists under the name of the output{model}',
    )


def topic_remap(options: argparse.Namespace) -> dict[str, str]:
    """Return the rules of --topics and --topic as a mapping.

    Nothing after := means that the topic is not read at all.

    >>> rules = ['imu/mag:=/compass', 'imu/temperature:=']
    >>> topic_remap(argparse.Namespace(topic=rules, topics=None))
    {'imu/mag': '/compass', 'imu/temperature': ''}
    """
    remap = topics_file(options.topics) if options.topics else {}
    for rule in options.topic:
        name, separator, other = rule.partition(':=')
        if not (separator and name):
            raise UserError(f'--topic {rule!r}: write it as name:=other, e.g. imu/mag:=/compass')
        remap[name] = other
    return remap


def topics_file(path: Path) -> dict[str, str]:
    """Return the rules of a --topics file; UserError names the file, the line and the key."""
    try:
        content = yaml.safe_load(path.read_text('utf-8'))
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise UserError(f'--topics {path}: not a YAML file: {fault_in_yaml(error)}') from None
    if not isinstance(content, dict):
        raise UserError(f'--topics {path}: expected lines such as "imu/mag: /compass"')
    for name, other in content.items():
        if name not in TRACK_OF_TOPIC:
            near = did_you_mean(str(name), TRACK_OF_TOPIC)
            raise UserError(
                f'--topics {path}: {name!r} is no name in a recording{near}; '
                f'known: {", ".join(TRACK_OF_TOPIC)}'
            )
        if not isinstance(other, str | None):
            raise UserError(f'--topics {path}: {name}: {other!r} is no topic')
    return {name: other or '' for name, other in content.items()}


def read_recordings(
    options: argparse.Namespace,
    *,
    every_device: bool = False,
    at_rest: bool = False,
    sensors: bool = True,
    model: ThermalModel | None = None,
) -> list[ImuRecording]:
    """Read the bags named on the command line, one recording per bag and device.

    Where a bag holds several devices and no --namespace was given, `every_device` takes all of
    them; otherwise the user has to choose. Refuses a device that moves where it has to be
    `at_rest`, and one that the `model` is not of.
    `sensors` False: the caller looks for implausible sensors itself.
    """
    return list(
        stream_recordings(
            options, every_device=every_device, at_rest=at_rest, sensors=sensors, model=model
        )
    )


def stream_recordings(
    options: argparse.Namespace,
    *,
    every_device: bool = False,
    at_rest: bool = False,
    sensors: bool = True,
    model: ThermalModel | None = None,
    then: str = '',
) -> Iterator[ImuRecording]:
    """Read the bags as `read_recordings` does, each only when it is asked for.

    `then` is the progress line when the last one has been read.
    """
    from imu_recording.plausibility import admitted
    from thermal_comp.data.motion import refuse_moving
    from thermal_comp.model.file import check_device

    remap = topic_remap(options)
    for path in options.bags:
        show_progress(f'reading {path} …')
        for recording in read_devices(path, options.namespace, remap, every_device=every_device):
            taken = admitted(recording, options.accept, sensors=sensors)
            check_device(model, taken.device)
            if at_rest:
                refuse_moving(taken)
            yield taken
            del recording, taken  # before the next one is read
    show_progress(then)


def save_unless_worse(
    model: ThermalModel, worse: Sequence[str], options: argparse.Namespace
) -> tuple[str, int]:
    """Save a model unless a simpler one is better; return the lines to show, and the exit code."""
    from thermal_comp.model.file import save_model
    from thermal_comp.model.values import ModelError

    if worse and not options.force:
        return f'not saved: {"; ".join(worse)}; --force saves it', CHECK_FAILED
    try:
        save_model(model, options.output)
    except ModelError as error:  # what was found is shown all the same
        return str(error), CHECK_FAILED
    lows, highs = zip(*(s.temperature_range for s in model.sensors.values()), strict=True)
    low, high = min(lows), max(highs)
    saved = f'saved {options.output}, which holds from {low:.1f} to {high:.1f} °C'
    reference = model.reference_temperature
    if (beyond := max(low - reference, reference - high)) >= LEAST_TOLD_DISTANCE_K:
        saved += (
            f'; it corrects to what values are at {reference:g} °C, {beyond:.1f} K outside that: '
            'measure a bias with the model applied, not without'
        )
    return saved, 0
