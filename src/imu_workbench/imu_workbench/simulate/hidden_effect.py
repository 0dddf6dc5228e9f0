# SPDX-License-Identifier: Apache-2.0
"""A campaign with a hidden effect, the file with the truth, the score of a diagnosis."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from chamber_profile.profile.values import Profile
from imu_driver.simulation.devices import DeviceParameters, draw_device
from imu_driver.simulation.effects.hidden_effect import Truth
from imu_driver.simulation.hidden import HIDDEN_EFFECTS, hide_anything, random_name
from imu_driver.simulation.run import DeviceRun
from imu_recording.user_error import UserError

from imu_recording import ImuRecording
from imu_workbench.simulate.campaign import (
    ORIENTATIONS,
    Logging,
    prepare_campaign,
    record_campaign,
)

TRUTH_FILE = '.truth.json'
BUNDLED_TRUTH_FILE = '.hidden_effect_truth.json'
"""The truth of the bags that ship with the repository."""
PLAN = 'paper_betta2022'


@dataclass(frozen=True)
class Campaign:
    """Recordings of one device in several orientations, and what is hidden in them."""

    recordings: list[ImuRecording]
    truth: Truth


@dataclass(frozen=True)
class HiddenEffect:
    """Name, size and sensor of what is hidden."""

    name: str
    """An effect, a fault, 'nothing', or 'random'."""
    magnitude: float = 2.0
    sensor: str | None = None
    """None: the seed chooses."""


def hidden_campaign(
    profile: str | Profile,
    device: str | DeviceParameters,
    logging: Logging,
    hidden_effect: HiddenEffect,
    *,
    seed: int,
    orientations: Sequence[str] = ORIENTATIONS,
) -> Campaign:
    """Return a campaign with a hidden effect."""
    runs = prepare_campaign(profile, device, seed=seed, orientations=orientations)
    return record_hidden(runs, logging, hidden_effect, seed=seed)


def record_hidden(
    runs: Sequence[DeviceRun], logging: Logging, hidden_effect: HiddenEffect, *, seed: int
) -> Campaign:
    """Hide the effect in prepared runs and read them out."""
    name = random_name(seed) if hidden_effect.name == 'random' else hidden_effect.name
    hidden = hide_anything(
        runs, name, magnitude=hidden_effect.magnitude, seed=seed, sensor=hidden_effect.sensor
    )
    recordings = record_campaign(hidden.runs, logging, startup_time=hidden.startup_time)
    return Campaign(hidden.finish(recordings), hidden.truth)


def practice_campaign(
    hidden_effects: Sequence[HiddenEffect],
    *,
    seed: int,
    mean_s: float = 5.0,
    bias_instability: float = 1.0,
    chamber_seed: int | None = None,
) -> tuple[list[ImuRecording], list[Truth]]:
    """Return a campaign of a device drawn from the class, for studies over hundreds of them.

    `hidden_effects` are hidden on top of each other (none: nothing is hidden); rows are means over
    `mean_s`; `bias_instability` multiplies the class's flicker noise. The chambers of
    `chamber_seed` (default: one of eight by the seed) are computed once and kept.
    """
    device = scale_bias_instability(draw_device(seed), bias_instability)
    place = seed % 8 if chamber_seed is None else chamber_seed
    runs = prepare_campaign(PLAN, device, seed=seed, chamber_seed=place)
    truths = []
    finishes = []
    startup_time = 0.0
    names = [
        random_name(seed + number) if hidden_effect.name == 'random' else hidden_effect.name
        for number, hidden_effect in enumerate(hidden_effects)
    ]
    # Where the device stands is settled before anything acts on it.
    for settle in (HIDDEN_EFFECTS[name].mounting for name in names if name in HIDDEN_EFFECTS):
        runs = [settle(run) for run in runs] if settle else runs
    for number, (name, hidden_effect) in enumerate(zip(names, hidden_effects, strict=True)):
        hidden = hide_anything(
            runs,
            name,
            magnitude=hidden_effect.magnitude,
            seed=seed + 1000 * number,
            sensor=hidden_effect.sensor,
        )
        runs = hidden.runs
        truths.append(hidden.truth)
        finishes.append(hidden.finish)
        startup_time = max(startup_time, hidden.startup_time)
    recordings = record_campaign(
        runs, Logging(1.0 / mean_s, mean=True, chamber_period=mean_s), startup_time=startup_time
    )
    for finish in finishes:
        recordings = finish(recordings)
    return recordings, truths


def scale_bias_instability(device: DeviceParameters, factor: float) -> DeviceParameters:
    """Return the device with its bias instability multiplied."""
    changed: dict[str, Any] = {
        name: replace(part, bias_instability=factor * part.bias_instability)
        for name in ('accelerometer', 'gyroscope', 'magnetometer')
        if (part := device.sensor(name))
    }
    return replace(device, **changed)


def write_truth(path: Path, truth: Truth, **context: Any) -> None:
    """Write the truth beside the bags."""
    content = {'schema': 1, **asdict(truth), **context}
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + '\n', 'utf-8')


def find_truth(folder: Path) -> tuple[dict[str, Any], list[Path]]:
    """Return the truth in a folder and the bags it is about."""
    for name in (TRUTH_FILE, BUNDLED_TRUTH_FILE):
        if (folder / name).is_file():
            return _read_truth(folder / name)
    raise FileNotFoundError(
        2, 'no truth here; `simulate … --hide` writes one beside its bags', str(folder)
    )


def _read_truth(path: Path) -> tuple[dict[str, Any], list[Path]]:
    try:
        truth = json.loads(path.read_text('utf-8'))
        return truth, [path.parent / bag for bag in truth['bags']]
    except (ValueError, KeyError, TypeError) as error:
        raise UserError(f'{path}: not what `simulate … --hide` writes ({error})') from None


ALARMS = ('effect', 'unexplained', 'unlogged')
"""Kinds of finding that must not appear where nothing is hidden."""
VERDICTS = {
    'named': 'right: it is the first thing named',
    'in_set': 'right: it is in the reported set, not in first place',
    'missed': 'missed: nothing of the kind was reported',
    'wrong': 'wrong: something else was reported',
}


@dataclass(frozen=True)
class Score:
    """A diagnosis compared with the truth."""

    outcome: str
    """One of VERDICTS."""
    sensor_right: bool
    """Whether the finding that counts is in the right sensor."""
    reported: tuple[str, ...]
    """What was reported, strongest first."""

    @property
    def right(self) -> bool:
        """Whether the truth is among what was reported, in its sensor."""
        return self.outcome in ('named', 'in_set') and self.sensor_right


def score_diagnosis(truth: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> Score:
    """Return how the JSON answer of `diagnose` compares with the truth of a campaign.

    >>> truth = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope'}
    >>> finding = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope'}
    >>> score_diagnosis(truth, {'findings': [finding]}).outcome
    'named'
    >>> score_diagnosis(truth, {'findings': []}).outcome
    'missed'
    """
    findings: Sequence[Mapping[str, Any]] = diagnosis['findings']
    reported = tuple(describe(finding) for finding in findings)
    if truth['kind'] == 'nothing':
        alarms = [finding for finding in findings if finding['kind'] in ALARMS]
        return Score('wrong' if alarms else 'named', True, reported)
    fitting = [k for k, finding in enumerate(findings) if fits(truth, finding)]
    if not fitting:
        others = any(finding['kind'] in (*ALARMS, 'data_quality') for finding in findings)
        return Score('wrong' if others else 'missed', False, reported)
    best = fitting[0]
    first = best == 0 and not _only_as_rival(truth, findings[best])
    right_sensor = any(same_sensor(truth['sensor'], findings[k]['sensor']) for k in fitting)
    return Score('named' if first else 'in_set', right_sensor, reported)


def fits(truth: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    """Tell whether a finding is what was hidden, by name or, beyond the catalogue, by variable."""
    if truth['kind'] in ('unexplained', 'unlogged'):
        variables = [*truth['depends_on'], *_close_to(truth['depends_on'])]
        return finding['kind'] in ('unexplained', 'unlogged') and (
            finding.get('depends_on') in variables
        )
    names = [finding.get('name'), *finding.get('ambiguous_with', ())]
    return finding['kind'] == truth['kind'] and truth['name'] in names


def same_sensor(true: str | None, reported: str | None) -> bool:
    """Tell whether a reported sensor covers the true one.

    >>> same_sensor('gyroscope', 'all'), same_sensor('gyroscope', 'accelerometer+magnetometer')
    (True, False)
    """
    if true is None or reported is None:
        return True
    if 'all' in (true, reported):
        return True
    return bool(set(true.split('+')) & set(reported.split('+')))


def describe(finding: Mapping[str, Any]) -> str:
    """Return one finding in a few words."""
    what = finding.get('name') or f'{finding["kind"]} ({finding.get("depends_on") or "?"})'
    rivals = finding.get('ambiguous_with') or ()
    alternative = f' or {" or ".join(rivals)}' if rivals else ''
    return f'{what}{alternative} in {finding.get("sensor") or "?"}'


def describe_truth(truth: Mapping[str, Any]) -> str:
    """Return what was hidden in a few words."""
    if truth['kind'] == 'nothing':
        return 'nothing'
    size = f'M = {truth["magnitude"]:g}'
    if truth['kind'] == 'unlogged':
        return f'{truth["law"]} in {truth["sensor"]}, {size}, without the log of its cause'
    beyond = ', beyond the catalogue' if truth['kind'] == 'unexplained' else ''
    return f'{truth["law"]} in {truth["sensor"]}, {size}{beyond}'


def _only_as_rival(truth: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    return truth['kind'] in ('effect', 'data_quality') and finding.get('name') != truth['name']


def _close_to(variables: Sequence[str]) -> tuple[str, ...]:
    """Return variables that stand for the same: the cycle number grows with time."""
    return ('cycle',) if 'time' in variables else ()
