# SPDX-License-Identifier: Apache-2.0
"""A simulated experiment: a profile run in a simulated chamber with a simulated device in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from chamber_profile.profile.file import load_profile, parse_profile
from chamber_profile.profile.values import Profile
from chamber_profile.run.simulation import simulate_chamber
from imu_driver.simulation.devices import DeviceParameters, find_device
from imu_driver.simulation.environment import Environment
from imu_driver.simulation.read_out import ReadOut, read_out
from imu_driver.simulation.run import DeviceRun, prepare_run
from imu_recording.logging_contract import CHANNEL_FIELDS

from imu_recording import ImuRecording

ORIENTATIONS = ('+x', '+y', '+z')
"""The three runs of a campaign (Betta et al. 2022, Fig. 3)."""


@dataclass(frozen=True)
class Logging:
    """How a simulated recording is logged."""

    rate_hz: float
    """Rate of the rows [Hz]."""
    mean: bool = False
    """Rows are means over their interval instead of single samples."""
    chamber_period: float = 1.0
    """Period of the chamber's tracks [s]; never shorter than that of the rows."""


def simulate_run(
    profile: str | Profile,
    device: str | DeviceParameters,
    logging: Logging,
    *,
    seed: int,
    orientation: str = '+z',
    field_jumps: bool = False,
) -> ImuRecording:
    """Return what a device records in one orientation while the chamber runs the profile.

    >>> run = simulate_run('short_20min', 'dut1', Logging(0.5), seed=1, orientation='+x')
    >>> run.device, run.up_axis, run.profile
    ('dut1', '+x', 'short_20min')
    """
    return simulate_campaign(
        profile, device, logging, seed=seed, orientations=(orientation,), field_jumps=field_jumps
    )[0]


def simulate_campaign(
    profile: str | Profile,
    device: str | DeviceParameters,
    logging: Logging,
    *,
    seed: int,
    orientations: Sequence[str] = ORIENTATIONS,
    field_jumps: bool = False,
) -> list[ImuRecording]:
    """Return one recording per orientation, each run on a day of its own."""
    runs = prepare_campaign(
        profile, device, seed=seed, orientations=orientations, field_jumps=field_jumps
    )
    return record_campaign(runs, logging)


def prepare_campaign(
    profile: str | Profile,
    device: str | DeviceParameters,
    *,
    seed: int,
    orientations: Sequence[str] = ORIENTATIONS,
    field_jumps: bool = False,
    chamber_seed: int | None = None,
) -> list[DeviceRun]:
    """Return the runs before they are read out, one per orientation.

    A run depends on seed, device and its own orientation only: alone or in a campaign it is the
    same. Devices with one seed share the chamber, not the noise.
    `chamber_seed` (default: the seed) is that of the chamber's runs; the latest are cached.
    """
    known = profile if isinstance(profile, Profile) else load_profile(profile)
    return [
        prepare_run(
            device,
            chamber_environment(known, seed if chamber_seed is None else chamber_seed, axis),
            seed=(seed, *axis.encode(), *find_device(device).name.encode()),
            orientation=axis,
            field_jumps=field_jumps,
        )
        for axis in orientations
    ]


def record_campaign(
    runs: Sequence[DeviceRun], logging: Logging, *, startup_time: float = 0.0
) -> list[ImuRecording]:
    """Return the recordings of prepared runs."""
    how = ReadOut(logging.rate_hz, logging.mean, startup_time)
    return [
        hold_tracks(
            replace(
                read_out(run, replace(how, number=number)),
                run=f'{run.device.name}_{run.orientation.lstrip("+")}',
            ),
            logging.chamber_period,
        )
        for number, run in enumerate(runs)
    ]


def chamber_environment(profile: Profile, seed: int, orientation: str = '+z') -> Environment:
    """Return the environment in a simulated chamber during one run of the profile."""
    day = ORIENTATIONS.index(orientation) if orientation in ORIENTATIONS else 3
    return _environment(profile.text, profile.source, 4 * seed + day)


@lru_cache(maxsize=32)
def _environment(text: str, source: str, seed: int) -> Environment:
    profile = parse_profile(text, source)
    run = simulate_chamber(profile, seed=seed)
    return Environment(
        time=run.time,
        air_temperature=run.air,
        chamber_temperature=run.temperature,
        chamber_temperature_2=run.temperature_2,
        setpoint=run.setpoint,
        heater=run.heater,
        compressor=run.compressor,
        fan=run.fan,
        humidity=run.humidity,
        phase=np.asarray(run.phase, dtype=np.int64),
        cycle=np.asarray(run.cycle, dtype=np.int64),
        profile=profile.name,
    )


def hold_tracks(recording: ImuRecording, period: float) -> ImuRecording:
    """Return the recording with its slow tracks renewed only every `period` seconds."""
    interval = np.floor(recording.time / period + 1e-9).astype(np.int64)
    first = np.searchsorted(interval, interval, side='left')
    held: dict[str, Any] = {
        name: getattr(recording, name)[first]
        for name in CHANNEL_FIELDS
        if getattr(recording, name) is not None
    }
    return replace(recording, **held)
