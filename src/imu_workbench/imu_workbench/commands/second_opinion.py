# SPDX-License-Identifier: Apache-2.0
"""Assess the temperature curves of an autopilot by the log they come from."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.logs.dataflash import is_dataflash
from imu_recording.logs.import_log import import_log, is_log
from imu_recording.plausibility import admitted
from imu_recording.recording import STANDARD_GRAVITY
from imu_recording.user_error import UserError
from thermal_comp.comparison.compare import rms_of
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.motion import refuse_moving
from thermal_comp.data.quality import check_motion, check_recording
from thermal_comp.presentation.display import shown
from thermal_comp.presentation.second_opinion import opinion_picture
from thermal_comp.second_opinion.autopilot_fit import AUTOPILOT_FITS, Autopilot
from thermal_comp.second_opinion.opinion import (
    OtherLogs,
    SecondOpinion,
    SensorOpinion,
    on_other_logs,
    second_opinion,
)

from imu_recording import ImuRecording
from imu_workbench.answer import Answer, show_progress
from imu_workbench.bag_devices import read_devices
from imu_workbench.commands.compare import claim_picture
from imu_workbench.commands.options import add_accept_argument

HELP = 'Judge the curves that PX4 or ArduPilot would fit to a warm-up log: good, or not, and why.'
EPILOG = (
    'A log (.ulg, .bin) is judged by the curves of its own autopilot, a bag of `import` by those\n'
    'of --autopilot. Held out: each part of the log is judged by the curve of the rest; of\n'
    'several logs of one IMU, each also by the curves of the others.\n'
    'examples:\n'
    '  python -m imu_workbench second-opinion warmup.ulg --plot opinion.png\n'
    '  python -m imu_workbench second-opinion monday.ulg friday.ulg\n'
    '  python -m imu_workbench second-opinion warmup/imu0 --autopilot ardupilot'
)
AUTOPILOT_NAMES: dict[Autopilot, str] = {'px4': 'PX4', 'ardupilot': 'ArduPilot'}
AUTOPILOT_UNITS: dict[Sensor, tuple[float, str]] = {
    'accelerometer': (1e3 / STANDARD_GRAVITY, 'mg'),
    'gyroscope': (180.0 / np.pi, '°/s'),
}
"""Factor from SI and unit, as usual with autopilots."""
GOOD_NOISE_RATIO = 1.5
"""Times the noise floor up to which curves are good."""
SMALL_NOISE_RATIO = 2.0
"""Times the noise floor up to which the error while cooling is small."""
LEAST_RANGE_K = 25.0
"""Least range of temperature of a log that covers the weather [K]."""


def arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument('logs', metavar='LOG', type=Path, nargs='+', help='.ulg, .bin or a bag')
    parser.add_argument(
        '--autopilot',
        choices=tuple(AUTOPILOT_FITS),
        help='whose curves; without it that of the log',
    )
    parser.add_argument('--plot', metavar='FILE', type=Path, help='draw it (.png, .svg, .pdf)')
    parser.add_argument('--seed', type=int, default=0, help='of what is drawn (%(default)s)')
    parser.add_argument(
        '--force', action='store_true', help='replace what exists under the name of the picture'
    )
    add_accept_argument(parser)


def run(options: argparse.Namespace) -> Answer:
    """Judge every IMU of every log."""
    if options.plot:
        claim_picture(options.plot, force=options.force)
    rows, lines, opinions = [], [], []
    for name, recording, own in _imus(options):
        show_progress(f'{name}: fitting …')
        autopilot = options.autopilot or own
        parts, defects = check_motion(admitted(recording, options.accept), name)
        longest = max(parts, key=lambda part: np.isfinite(part.linear_acceleration).sum())
        clean, found = check_recording(longest, name)
        defects += found
        refuse_moving(clean)
        try:
            opinion = second_opinion(clean, autopilot, seed=options.seed)
        except UserError as error:
            raise UserError(f'{name}: {error}') from None
        faults = [f'{defect.name}: {defect.text}' for defect in defects]
        said = verdict(opinion)
        rows.append(_row(name, opinion, faults, said))
        lines += [name, *(f'  first: {fault}' for fault in faults), *(f'  {s}' for s in said)]
        lines += [f'  note: {note}' for note in opinion.notes]
        opinions.append((name, opinion))
    across, said = _across(opinions)
    lines += said
    if options.plot:
        opinion_picture(opinions, AUTOPILOT_UNITS).savefig(options.plot, dpi=120)
        lines.append(f'wrote {options.plot}')
    content = {'schema': 1, 'imus': rows, 'other_logs': across, 'plot': options.plot}
    return Answer(content, '\n'.join(lines))


def _across(
    opinions: Sequence[tuple[str, SecondOpinion]],
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return the errors of curves on other logs of their device, for JSON and as lines."""
    groups: dict[tuple[str, Autopilot], list[tuple[str, SecondOpinion]]] = {}
    for name, opinion in opinions:
        groups.setdefault((opinion.device, opinion.autopilot), []).append((name, opinion))
    content, lines = [], []
    for (device, autopilot), members in groups.items():
        if len(members) < 2:
            continue
        found = on_other_logs([opinion for _, opinion in members])
        said = _worth(found) if found else 'the logs share no temperatures: nothing to compare'
        each = '; '.join(
            f'{sensor} {_in_units(sensor, rms_of(part.left))}, '
            f'nothing subtracted {_in_units(sensor, rms_of(part.raw))}'
            for sensor, part in found.items()
        )
        lines.append(f'{device}, {len(members)} logs')
        left = f'the curve of one log leaves on the others: {each} – ' if each else ''
        lines.append(f'  {left}{said}.')
        sensors = {
            sensor: {
                'pairs': part.pairs,
                'raw_rms': part.raw,
                'left_rms': part.left,
                'own_log_held_out_rms': part.own,
            }
            for sensor, part in found.items()
        }
        names = [name for name, _ in members]
        row = {'device': device, 'autopilot': autopilot, 'logs': names, 'sensors': sensors}
        content.append(row | {'verdict': said})
    return content, lines


def _worth(found: Mapping[Sensor, OtherLogs]) -> str:
    """Return whether curves hold from log to log."""
    worse = [sensor for sensor, part in found.items() if rms_of(part.left) >= rms_of(part.raw)]
    if worse:
        return f'they do not hold: on other logs they make the {" and ".join(worse)} worse'
    if all(rms_of(part.left) <= GOOD_NOISE_RATIO * rms_of(part.own) for part in found.values()):
        return 'they hold from log to log'
    return 'they help, but less than within their own log: lag, hysteresis or another mounting'


def _imus(options: argparse.Namespace) -> Iterator[tuple[str, ImuRecording, Autopilot]]:
    """Yield name, recording and autopilot of every IMU."""
    for path in options.logs:
        show_progress(f'reading {path} …')
        if path.is_dir() or not is_log(path):
            for recording in read_devices(path, None, None, every_device=True):
                yield f'{path} {recording.namespace}'.rstrip(), recording, 'px4'
            continue
        with path.open('rb') as stream:
            own: Autopilot = 'ardupilot' if is_dataflash(stream.read(16)) else 'px4'
        for imu in import_log(path):
            yield f'{path} {imu.name}', imu.recording, own


def verdict(opinion: SecondOpinion) -> list[str]:
    """Return the verdict in three lines: errors of these curves, errors in cooling, what to do."""
    low, high = opinion.temperature_range
    worst = max(_times_floor(s, s.held_out) for s in opinion.sensors.values())
    judged = (
        'good: noise leaves as much'
        if worst <= GOOD_NOISE_RATIO
        else f'{shown(worst, 2)} times what noise would leave'
    )
    name = AUTOPILOT_NAMES[opinion.autopilot]
    each = '; '.join(
        f'{sensor} {_in_units(sensor, rms_of(part.held_out))}, '
        f'nothing subtracted {_in_units(sensor, rms_of(part.raw))}'
        for sensor, part in opinion.sensors.items()
    )
    lines = [
        f"{name}'s curves between {low:.0f} and {high:.0f} °C leave, held out: {each} – {judged}."
    ]
    back = '; '.join(
        f'{sensor} {_band(sensor, part.cooling)}' for sensor, part in opinion.sensors.items()
    )
    why = (
        f'{100.0 * opinion.both_ways:.0f} % of the range was passed both ways, which tells a lag '
        'from a curve'
        if opinion.decidable
        else 'one warm-up cannot tell a lag from a curve'
    )
    lines.append(f'Cooling as fast as it warmed, they will leave: {back}; {why}.')
    lines.append(f'Advice: {_advice(opinion, worst)}.')
    return lines


def _advice(opinion: SecondOpinion, worst: float) -> str:
    low, high = opinion.temperature_range
    later = max(_times_floor(s, s.cooling[1:2]) for s in opinion.sensors.values())
    advice = []
    if not opinion.decidable:
        advice.append('keep logging while the board cools down again, and ask once more')
    if high - low < LEAST_RANGE_K:
        advice.append(f'start colder or end warmer: {high - low:.0f} K is a narrow range')
    if opinion.decidable and max(worst, later) > max(GOOD_NOISE_RATIO, SMALL_NOISE_RATIO):
        advice.append(
            'a cubic is not enough: `import`, `auto`, then `export --to c99`, which has the lag'
        )
    elif worst > GOOD_NOISE_RATIO:
        advice.append('do not load these curves yet')
    elif opinion.decidable:
        advice.append(f'load these curves; they hold between {low:.0f} and {high:.0f} °C')
    else:
        advice.append('until then they are good for warming up')
    return '; '.join(advice)


def _row(name: str, opinion: SecondOpinion, faults: list[str], said: list[str]) -> dict[str, Any]:
    return {
        'imu': name,
        'device': opinion.device,
        'autopilot': opinion.autopilot,
        'verdict': said,
        'faults': faults,
        'notes': opinion.notes,
        'temperature_range': opinion.temperature_range,
        'both_ways': opinion.both_ways,
        'lag_or_curve': 'told apart' if opinion.decidable else 'cannot be told apart',
        'sensors': {
            sensor: {
                'coefficients': part.cubic.coefficients,
                'reference_temperature': part.cubic.reference,
                'temperature_range': [part.cubic.low, part.cubic.high],
                'raw_rms': part.raw,
                'held_out_rms': part.held_out,
                'noise_floor': part.noise_floor,
                'cooling_rms_percentiles_2_5_50_97_5': part.cooling,
            }
            for sensor, part in opinion.sensors.items()
        },
    }


def _times_floor(part: SensorOpinion, errors: np.ndarray[Any, Any]) -> float:
    return rms_of(errors) / max(rms_of(part.noise_floor), 1e-300)


def _in_units(sensor: Sensor, value: float) -> str:
    factor, unit = AUTOPILOT_UNITS[sensor]
    return f'{shown(factor * value, 2)} {unit}'


def _band(sensor: Sensor, percentiles: np.ndarray[Any, Any]) -> str:
    factor, unit = AUTOPILOT_UNITS[sensor]
    low, _, high = (shown(factor * value, 2) for value in percentiles)
    return f'{low} … {high} {unit}'
