# SPDX-License-Identifier: Apache-2.0
"""A campaign with a hidden effect, and the file with the truth."""

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
from imu_driver.simulation.hidden import (
    HIDDEN_EFFECTS,
    NOTHING,
    as_recorded,
    hide_anything,
    random_name,
)
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
from imu_workbench.tables.paper import PAPER_PROFILE

TRUTH_FILE = '.truth.json'
BUNDLED_TRUTH_FILE = '.hidden_effect_truth.json'
"""The truth of the bags that ship with the repository."""
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
    told = (as_recorded(hidden.truth, recordings, own) for hidden in done)
    truths = tuple(truth for truth in told if truth.kind != 'nothing')
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
    runs = prepare_campaign(PAPER_PROFILE, device, seed=seed, chamber_seed=place)
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
