# SPDX-License-Identifier: Apache-2.0
"""Parameters of chamber_profile_node, and the run they describe."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from imu_recording.ros.parameter import NodeConfig, ParameterError, parameter

from chamber_profile.chambers.catalogue import EXAMPLE_ADDRESSES, open_chamber
from chamber_profile.profile.file import load_profile, profile_names
from chamber_profile.profile.unroll import signed_axis
from chamber_profile.profile.values import Profile
from chamber_profile.run.chamber_link import ChamberLink
from chamber_profile.run.conductor import Clocks, Conductor, ExternalReadings
from chamber_profile.run.journal import holds_run, load_run
from chamber_profile.run.sequencer import Sequencer
from chamber_profile.run.values import DONE, FINISHED, IDLE, Progress

STEP_PERIOD_S = 0.5
"""Period of a run's steps [s of the chamber]."""
MIN_STEP_PERIOD_S = 0.02
"""Shortest period of a run's steps [s of the host]."""


@dataclass(frozen=True)
class ChamberConfig(NodeConfig):
    """Parameters of chamber_profile_node."""

    profile: str = parameter('', f'Profile file, or one of {", ".join(profile_names())}')
    chamber: str = parameter('simulated', f'The chamber: {EXAMPLE_ADDRESSES}')
    start: bool = parameter(False, 'Begin the run at activation and exit at its end')
    orientation: str = parameter(
        '', 'Sensor axis that points up, where the profile does not say',
        choices=('', 'x', 'y', 'z', '-x', '-y', '-z', '+x', '+y', '+z'),
    )  # fmt: skip
    require_imu: bool = parameter(True, 'An IMU silent for 10 s ends the run in the safe state')
    imu_topics: list[str] = parameter(  # noqa: RUF009 (a default factory underneath)
        ['imu/temperature'], 'Signs of life of the IMU; any of them counts'
    )
    recorder: str = parameter('recorder', 'Node whose errors in /diagnostics end the run safely')
    time_scale: float = parameter(
        1.0, 'Chamber seconds per second; only for an emulated chamber', bounds=(0.01, 1000.0)
    )
    run_directory: str = parameter(
        '', 'Where journal and profile go (empty: runs/PROFILE_UTC); an interrupted run resumes'
    )
    publish_temperature: bool = parameter(
        True, "Publish the chamber's own temperatures; false: use those of a reference logger"
    )


@dataclass(frozen=True)
class Run:
    """A run ready to be started."""

    conductor: Conductor
    directory: Path
    period_s: float
    """Period of its steps [s of the host]."""
    exits: bool
    """Whether the process ends with the run."""
    resumed: bool

    def exit_code(self, progress: Progress) -> int | None:
        """Return 0 or 1 where the process is to end now, None where it goes on."""
        if not self.exits:
            return None
        refused = progress.mode == IDLE and progress.reason.startswith('check failed')
        if progress.mode in FINISHED or refused:
            return 0 if progress.mode == DONE else 1
        return None


def open_run(
    config: ChamberConfig,
    now: Callable[[], int],
    external: Callable[[], ExternalReadings],
    *,
    simulated_time: bool,
) -> Run:
    """Return the run that the parameters describe; raise ValueError where they describe none."""
    chamber = open_chamber(config.chamber)
    profile, progress, directory = _profile_and_progress(config)
    clocks = _clocks(config.time_scale, now, simulated_time=simulated_time)
    link = ChamberLink(chamber, clocks.host, config.time_scale)
    sequencer = Sequencer(profile, progress=progress, timeout_factor=max(config.time_scale, 1.0))
    conductor = Conductor(sequencer, link, directory, clocks, external)
    period = max(STEP_PERIOD_S / config.time_scale, MIN_STEP_PERIOD_S)
    return Run(
        conductor=conductor,
        directory=directory,
        period_s=period,
        exits=config.start,
        resumed=progress is not None,
    )


def _profile_and_progress(config: ChamberConfig) -> tuple[Profile, Progress | None, Path]:
    """Return profile, progress (None: a new run) and run directory of the parameters."""
    directory = Path(config.run_directory) if config.run_directory else None
    progress = None
    if directory is not None and holds_run(directory):
        interrupted = load_run(directory)
        profile, progress = interrupted.profile, interrupted.progress
        _check_same(config.profile, profile, directory)
    elif config.profile:
        profile = load_profile(config.profile)
    else:
        raise ParameterError(
            f'profile is empty: give a file, or one of {", ".join(profile_names())}'
        )
    if config.orientation and not profile.orientations:
        profile = replace(profile, orientations=(signed_axis(config.orientation),))
    if directory is None:
        began = datetime.now(UTC).strftime('%Y%m%dT%H%M%SZ')
        directory = Path('runs') / f'{profile.name}_{began}'
    return profile, progress, directory


def _check_same(asked: str, profile: Profile, directory: Path) -> None:
    if asked and load_profile(asked).sha256 != profile.sha256:
        raise ParameterError(
            f'{directory} holds a run of another profile ({profile.name}) than {asked}: leave '
            f'profile empty to resume it, or run_directory empty to begin anew'
        )


def _clocks(time_scale: float, now: Callable[[], int], *, simulated_time: bool) -> Clocks:
    """Return the clocks of a run; under simulated time ROS's clock is the host's, too."""
    host = partial(_scaled, now, 1e-9) if simulated_time else time.monotonic
    return Clocks(host=host, chamber=partial(_scaled, host, time_scale), stamp=now)


def _scaled(clock: Callable[[], float], factor: float) -> float:
    return clock() * factor
