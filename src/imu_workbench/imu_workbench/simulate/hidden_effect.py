# SPDX-License-Identifier: Apache-2.0
"""A campaign with a hidden effect, the file with the truth, the score of a diagnosis."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from chamber_profile.profile.values import Profile
from imu_driver.simulation.ageing import draw_ageing
from imu_driver.simulation.devices import DeviceParameters, draw_device, find_device
from imu_driver.simulation.effects.hidden_effect import HiddenEffect, Truth
from imu_driver.simulation.hidden import HIDDEN_EFFECTS, NOTHING, hide_anything, random_name
from imu_driver.simulation.run import DeviceRun
from imu_recording.user_error import UserError
from thermal_comp.data.conditions import SENSORS

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
NOTHING_HIDDEN = Truth(None, 'nothing', law=NOTHING)


@dataclass(frozen=True)
class SimulatedCampaign:
    """Recordings of one device in several orientations, and what is hidden in them."""

    recordings: list[ImuRecording]
    truths: tuple[Truth, ...]
    """In the order asked for; one of kind 'nothing' where nothing is hidden."""
    changes: dict[str, Any] | None = None
    """What has changed since an earlier campaign of the device."""


@dataclass(frozen=True)
class EffectToHide:
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
    hidden_effects: Sequence[EffectToHide],
    *,
    seed: int,
    orientations: Sequence[str] = ORIENTATIONS,
    aged: bool = False,
    own: Mapping[str, HiddenEffect] = MappingProxyType({}),
) -> SimulatedCampaign:
    """Return a campaign with hidden effects, or that of the same device a year later.

    `aged`: device and hidden effects are those of the seed, older by seeded `changes`; chamber,
    noise and placement are those of another day. `own` are effects to hide beside those the
    simulator has.
    """
    runs = prepare_campaign(profile, device, seed=seed, orientations=orientations)
    if not aged:
        return record_hidden(runs, logging, hidden_effects, seed=seed, own=own)
    ageing = draw_ageing(find_device(device), seed)
    later = prepare_campaign(
        profile,
        ageing.of(find_device(device)),
        seed=int(np.random.default_rng((seed, 47)).integers(2**31)),
        orientations=orientations,
    )
    grown = [
        replace(effect, magnitude=ageing.effect_ratio * effect.magnitude)
        for effect in hidden_effects
    ]
    campaign = record_hidden(later, logging, grown, seed=seed, measured_on=runs, own=own)
    return replace(campaign, changes=ageing.to_dict())


def record_hidden(
    runs: Sequence[DeviceRun],
    logging: Logging,
    hidden_effects: Sequence[EffectToHide],
    *,
    seed: int,
    measured_on: Sequence[DeviceRun] | None = None,
    own: Mapping[str, HiddenEffect] = MappingProxyType({}),
) -> SimulatedCampaign:
    """Hide the effects in prepared runs, on top of each other, and read them out.

    Magnitudes are those in `measured_on` where given: runs of the device before it aged.
    """
    names = [
        random_name(seed + number) if hidden_effect.name == 'random' else hidden_effect.name
        for number, hidden_effect in enumerate(hidden_effects)
    ]
    # The mounting comes first: every effect acts on the device where it stands then.
    for settle in (HIDDEN_EFFECTS[name].mounting for name in names if name in HIDDEN_EFFECTS):
        if settle:
            runs = [settle(run) for run in runs]
            measured_on = measured_on and [settle(run) for run in measured_on]
    done = []
    for number, (name, hidden_effect) in enumerate(zip(names, hidden_effects, strict=True)):
        hidden = hide_anything(
            runs,
            name,
            magnitude=hidden_effect.magnitude,
            seed=seed + 1000 * number,
            sensor=hidden_effect.sensor,
            measured_on=measured_on,
            own=own,
        )
        runs = hidden.runs
        done.append(hidden)
    startup_time = max((hidden.startup_time for hidden in done), default=0.0)
    recordings = record_campaign(runs, logging, startup_time=startup_time)
    for hidden in done:
        recordings = hidden.finish(recordings)
    truths = tuple(hidden.truth for hidden in done if hidden.truth.kind != 'nothing')
    return SimulatedCampaign(recordings, truths or (NOTHING_HIDDEN,))


def practice_campaign(
    hidden_effects: Sequence[EffectToHide],
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
    logging = Logging(1.0 / mean_s, mean=True, chamber_period=mean_s)
    campaign = record_hidden(runs, logging, hidden_effects, seed=seed)
    return campaign.recordings, list(campaign.truths)


def scale_bias_instability(device: DeviceParameters, factor: float) -> DeviceParameters:
    """Return the device with its bias instability multiplied."""
    changed: dict[str, Any] = {
        name: replace(part, bias_instability=factor * part.bias_instability)
        for name in SENSORS
        if (part := device.sensor(name))
    }
    return replace(device, **changed)


def write_truth(path: Path, campaign: SimulatedCampaign, **context: Any) -> None:
    """Write the truth beside the bags: what is hidden first at the top, the rest below it."""
    first, *others = [asdict(truth) for truth in campaign.truths]
    content = {'schema': 1, **first, **context}
    if others:
        content['also_hidden'] = others
    if campaign.changes:
        content['changes'] = campaign.changes
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


def all_hidden(truth: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the truth of every hidden effect, as read from a truth file."""
    return [truth, *truth.get('also_hidden', ())]


ALARMS = ('effect', 'unexplained', 'unlogged')
"""Kinds of finding that must not appear where nothing is hidden."""
VERDICTS = {
    'named': 'right: it is named first',
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


def score_each(truths: Sequence[Mapping[str, Any]], diagnosis: Mapping[str, Any]) -> list[Score]:
    """Return the score of every hidden effect, without findings that only another one explains.

    >>> lag = {'kind': 'effect', 'name': 'thermal_lag', 'sensor': 'gyroscope'}
    >>> ice = {'kind': 'effect', 'name': 'icing', 'sensor': 'gyroscope'}
    >>> [s.outcome for s in score_each([ice, lag], {'findings': [lag, ice]})]
    ['named', 'named']
    """
    scores = []
    for truth in truths:
        others = [other for other in truths if other is not truth]
        findings = [
            finding
            for finding in diagnosis['findings']
            if fits_in_sensor(truth, finding)
            or not any(fits_in_sensor(other, finding) for other in others)
        ]
        scores.append(score_diagnosis(truth, {**diagnosis, 'findings': findings}))
    return scores


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
    return finding['kind'] in (truth['kind'], 'changed', 'clock') and truth['name'] in names


def fits_in_sensor(truth: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    """Tell whether a finding is what was hidden, where it was hidden."""
    return fits(truth, finding) and same_sensor(truth.get('sensor'), finding.get('sensor'))


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


def describe_changes(changes: Mapping[str, Any]) -> list[str]:
    """Return what a year has changed, a line per sensor and one for hidden effects."""
    lines = [
        f'{sensor}: slope × {ratio:.3g}, offset '
        + ', '.join(f'{change:+.3g}' for change in changes['offset'][sensor])
        + ' (SI units)'
        for sensor, ratio in changes['slope_ratio'].items()
    ]
    amplitude, time_constant = changes['effect_ratio'], changes['time_constant_ratio']
    lines.append(
        f'hidden effects: amplitude × {amplitude:.3g}, time constant of a lag × '
        f'{time_constant:.3g}'
    )
    return lines


def _only_as_rival(truth: Mapping[str, Any], finding: Mapping[str, Any]) -> bool:
    return truth['kind'] in ('effect', 'data_quality') and finding.get('name') != truth['name']


def _close_to(variables: Sequence[str]) -> tuple[str, ...]:
    """Return variables that stand for the same: the cycle number grows with time."""
    return ('cycle',) if 'time' in variables else ()
