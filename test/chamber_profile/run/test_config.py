# SPDX-License-Identifier: Apache-2.0
"""The run that parameters describe: new or resumed, its clock, its exit code."""

from pathlib import Path

import pytest
from chamber_profile.run.conductor import ExternalReadings
from chamber_profile.run.config import ChamberConfig, open_run
from chamber_profile.run.values import ABORTED, DONE, IDLE, RUN, Progress
from imu_recording.ros.parameter import ParameterError


def opened(stamp: int = 0, **parameters):
    config = ChamberConfig(**{'profile': 'short_20min', **parameters})
    return open_run(config, lambda: stamp, ExternalReadings, simulated_time=True)


def test_a_new_run_has_a_directory_of_its_own_that_is_not_made_yet() -> None:
    run = opened()
    assert run.directory.parent == Path('runs')
    assert run.directory.name.startswith('short_20min_')
    assert not run.directory.exists()
    assert not run.resumed


def test_the_orientation_fills_in_what_the_profile_leaves_open() -> None:
    assert opened(orientation='x').conductor.sequencer.profile.orientations == ('+x',)
    campaign = opened(profile='paper_betta2022_campaign', orientation='x')
    assert campaign.conductor.sequencer.profile.orientations == ('+x', '+y', '+z')


@pytest.mark.parametrize(('scale', 'period'), [(0.5, 1.0), (1.0, 0.5), (5.0, 0.1), (1000.0, 0.02)])
def test_the_period_follows_the_time_scale_down_to_what_the_host_can(scale, period) -> None:
    assert opened(time_scale=scale).period_s == pytest.approx(period)


def test_the_chambers_clock_is_the_hosts_times_the_time_scale() -> None:
    clocks = opened(stamp=10**10, time_scale=60.0).conductor._clocks
    assert (clocks.host(), clocks.chamber(), clocks.stamp()) == (10.0, 600.0, 10**10)


@pytest.mark.parametrize(
    ('progress', 'code'),
    [
        (Progress(RUN), None),
        (Progress(DONE), 0),
        (Progress(ABORTED), 1),
        (Progress(IDLE), None),
        (Progress(IDLE, reason='check failed: alarm 4'), 1),
    ],
)
def test_only_a_process_that_was_started_with_its_run_ends_with_it(progress, code) -> None:
    assert opened(start=True).exit_code(progress) == code
    assert opened().exit_code(progress) is None


def test_a_run_without_a_profile_names_those_there_are() -> None:
    with pytest.raises(ParameterError, match=r'profile is empty: .*paper_betta2022'):
        opened(profile='')
