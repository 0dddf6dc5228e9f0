# SPDX-License-Identifier: Apache-2.0
"""A campaign with a hidden effect, and the truth that only `reveal` looks at."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from chamber_profile.profile import Profile
from imu_driver.device_parameters import DeviceParameters
from imu_driver.simulated_catalogue import draw_device
from imu_driver.simulated_effect import Truth
from imu_driver.simulated_hidden import hide_anything, random_name
from imu_driver.simulated_laws import LAWS
from imu_driver.simulated_run import DeviceRun
from imu_recording.user_error import UserError

from imu_recording import ImuRecording
from imu_workbench.experiment import ORIENTATIONS, Logging, prepare_campaign, record_campaign

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
class Secret:
    """What to hide."""

    name: str
    """An effect, a fault, 'nothing', or 'random'."""
    magnitude: float = 2.0
    sensor: str | None = None
    """None: the seed chooses."""


def hidden_campaign(
    profile: str | Profile,
    device: str | DeviceParameters,
    logging: Logging,
    secret: Secret,
    *,
    seed: int,
    orientations: Sequence[str] = ORIENTATIONS,
) -> Campaign:
    """Return a campaign with a secret in it."""
    runs = prepare_campaign(profile, device, seed=seed, orientations=orientations)
    return record_hidden(runs, logging, secret, seed=seed)


def record_hidden(
    runs: Sequence[DeviceRun], logging: Logging, secret: Secret, *, seed: int
) -> Campaign:
    """Hide the secret in prepared runs and read them out."""
    name = random_name(seed) if secret.name == 'random' else secret.name
    hidden = hide_anything(runs, name, magnitude=secret.magnitude, seed=seed, sensor=secret.sensor)
    recordings = record_campaign(hidden.runs, logging, startup_time=hidden.startup_time)
    return Campaign(hidden.finish(recordings), hidden.truth)


def practice_campaign(
    secrets: Sequence[Secret],
    *,
    seed: int,
    mean_s: float = 5.0,
    bias_instability: float = 1.0,
    chamber_seed: int | None = None,
) -> tuple[list[ImuRecording], list[Truth]]:
    """Return a campaign of a device drawn from the class, for studies over hundreds of them.

    `secrets` are hidden on top of each other (none: nothing is hidden); rows are means over
    `mean_s`; `bias_instability` multiplies the class's flicker noise. The chambers of
    `chamber_seed` (default: one of eight by the seed) are computed once and kept.
    """
    device = louder(draw_device(seed), bias_instability)
    place = seed % 8 if chamber_seed is None else chamber_seed
    runs = prepare_campaign(PLAN, device, seed=seed, chamber_seed=place)
    truths = []
    finishes = []
    startup_time = 0.0
    names = [
        random_name(seed + number) if secret.name == 'random' else secret.name
        for number, secret in enumerate(secrets)
    ]
    # Where the device stands is settled before anything acts on it.
    for settle in (LAWS[name].place for name in names if name in LAWS):
        runs = [settle(run) for run in runs] if settle else runs
    for number, (name, secret) in enumerate(zip(names, secrets, strict=True)):
        hidden = hide_anything(
            runs,
            name,
            magnitude=secret.magnitude,
            seed=seed + 1000 * number,
            sensor=secret.sensor,
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


def louder(device: DeviceParameters, factor: float) -> DeviceParameters:
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
