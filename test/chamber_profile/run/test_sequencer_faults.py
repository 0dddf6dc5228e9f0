# SPDX-License-Identifier: Apache-2.0
"""The sequencer when something fails, is aborted, or was killed: it ends in safety, or goes on."""

from dataclasses import replace

import numpy as np
import pytest
from chamber_profile.run.values import (
    ABORTED,
    CHECK,
    DONE,
    DWELL,
    HOLD_FAULT,
    IDLE,
    RUN,
    SAFE,
    Switch,
)

FAULTS = {
    'alarm': {'alarms': ('2', '19')},
    'air above the limits': {'air': 36.5},
    'air below the limits': {'air': 8.5},
    'device too hot': {'device': 86.0},
    'IMU silent': {'imu_alive': False},
    'disk full': {'disk_free': 1 << 29},
    'recorder': {'fault': 'disk full'},
    'link lost': {'link': 'lost'},
    'stopped at its panel': {'running': False},
}


@pytest.mark.parametrize('fault', FAULTS)
@pytest.mark.parametrize('where', ['heat', 'hot'])
def test_every_fault_leads_to_the_safe_state(harness, fault: str, where: str) -> None:
    it = harness(at=(where,))
    it.tick()
    it.world.update(FAULTS[fault])
    it.tick()
    assert it.mode in (SAFE, ABORTED)
    assert it.events[-1] in ('safe', 'stage', 'aborted')
    reason = it.sequencer.progress.reason
    it.world.clear()
    if fault == 'stopped at its panel':
        it.running = False
    it.run_to_the_end()
    assert it.mode == ABORTED
    assert not it.running
    assert reason
    switched_on = [a for t, a in it.log if isinstance(a, Switch) and a.on]
    assert len(switched_on) == 1  # never restarted
    if fault != 'stopped at its panel':
        assert it.writes[-1][1] == 20.0
        assert abs(it.air - 20.0) <= 2.1


def test_the_way_to_the_safe_temperature_keeps_the_safe_rate(harness) -> None:
    it = harness(at=('hot', DWELL))
    it.sequencer.command('abort')
    it.run_to_the_end()
    writes = [(t, v) for t, v in it.writes if v < 30.0][-60:]
    time, value = np.array(writes).T
    falling = np.diff(value) < 0
    assert (np.abs(np.diff(value)) <= 2.0 / 60 * np.diff(time) + 0.1 + 1e-9)[falling].all()
    assert it.mode == ABORTED


def test_a_short_fault_of_the_link_holds_and_goes_on(harness) -> None:
    it = harness(at=('heat',))
    for _ in range(60):
        it.tick()
    before = it.sequencer.progress.setpoint
    it.world['link'] = 'failing'
    for _ in range(12):
        it.tick()
    assert it.mode == HOLD_FAULT
    assert it.sequencer.progress.setpoint == before
    it.world.clear()
    it.tick()
    assert it.mode == RUN
    it.run_to_the_end()
    assert it.mode == DONE
    assert {'hold', 'recovered'} <= set(it.events)


def test_a_write_that_was_lost_is_repeated(harness) -> None:
    it = harness(at=('hot', DWELL))
    it.setpoint = 12.0  # someone else's hand
    it.run_until(lambda: it.setpoint == 30.0, longest_s=30)
    it.obeys = False
    it.setpoint = 12.0
    it.run_until(lambda: it.mode == SAFE, longest_s=120)
    assert '12' in it.sequencer.progress.reason


def test_a_chamber_that_does_not_start_is_given_up(harness) -> None:
    it = harness()
    it.obeys = False
    it.start()
    it.run_to_the_end()
    assert it.mode == ABORTED
    assert 'does not start' in it.sequencer.progress.reason


def test_a_chamber_out_of_reach_in_the_safe_state_is_given_up_in_time(harness) -> None:
    it = harness(at=('hot',))
    it.world['link'] = 'lost'
    began = it.time
    it.run_to_the_end()
    assert it.mode == ABORTED
    assert 'did not confirm' in it.sequencer.progress.reason
    assert 900 < it.time - began < 3000


@pytest.mark.parametrize(
    ('world', 'words'),
    [
        ({'alarms': ('7',)}, 'alarm 7'),
        ({'air': 40.0}, '40.0 °C, outside'),
        ({'device': 90.0}, 'device is at 90.0 °C'),
        ({'imu_alive': False}, 'IMU'),
        ({'disk_free': 1000}, 'GiB'),
        ({'link': 'failing'}, 'does not answer'),
    ],
)
def test_a_start_is_refused_while_something_is_wrong(harness, world: dict, words: str) -> None:
    it = harness()
    it.world.update(world)
    it.start()
    it.run_until(lambda: it.mode != CHECK, longest_s=60)
    assert it.mode == ABORTED
    assert words in it.sequencer.progress.reason
    assert not it.writes
    assert not it.running


def test_standby_at_once_stops_without_a_ramp(harness) -> None:
    it = harness(at=('hot',))
    it.sequencer.command('standby')
    it.tick()
    assert it.mode == ABORTED
    assert not it.running


def test_a_ramp_that_is_too_slow_is_reported_but_goes_on(harness) -> None:
    it = harness('paper_betta2022', lag_s=30.0)
    it.start()
    it.to_step('cool')
    it.lag_s = 2500.0  # the compressor is weak
    it.run_until(lambda: it.sequencer.step.id == 'cold')
    report = next(note for note in it.notes if note.event == 'ramp_rate')
    assert abs(report.details['measured']) < 1.6
    assert it.mode == RUN


def test_a_restart_reenters_the_step_settles_again_and_dwells_in_full(harness) -> None:
    it = harness(at=('hot', DWELL))
    for _ in range(100):
        it.tick()
    last = it.notes[-1].progress
    again = harness(it.profile, progress=replace(last, mode=IDLE), air=26.0)
    again.setpoint, again.running = 30.0, True
    for _ in range(10):
        assert again.tick() == []
    again.start()
    again.run_until(lambda: again.mode == RUN)
    assert again.sequencer.step.id == 'hot'
    assert again.events == ['start', 'limits', 'interrupted']
    assert again.sequencer.progress.interruptions == 1
    again.to_step('hot', DWELL)
    began = again.time
    again.run_until(lambda: again.sequencer.step.id != 'hot')
    assert again.time - began >= 120
    again.run_to_the_end()
    assert again.mode == DONE
    time, value = np.array(again.writes).T
    limit = 2.5 / 60 * np.diff(time) + 0.1
    assert (np.abs(np.diff(value)) <= limit + 1e-9).all()


def test_a_run_that_was_going_to_safety_does_so_after_a_restart(harness) -> None:
    it = harness(at=('hot', DWELL))
    it.sequencer.command('abort')
    it.tick()
    last = it.sequencer.progress
    again = harness(it.profile, progress=replace(last, mode=IDLE), air=30.0)
    again.setpoint, again.running = 30.0, True
    again.start()
    assert again.mode == SAFE
    again.run_to_the_end()
    assert again.mode == ABORTED
    assert not again.running


def test_a_clock_that_jumps_does_not_make_the_setpoint_jump(harness) -> None:
    it = harness(at=('heat',))
    for _ in range(30):
        it.tick()
    before = it.sequencer.progress.setpoint
    it.tick(3600.0)
    assert abs(it.sequencer.progress.setpoint - before) <= 2.5 / 60 * 10 + 1e-9
    it.time -= 7200.0
    here = it.sequencer.progress.setpoint
    it.tick()
    assert it.sequencer.progress.setpoint == here


def test_a_chamber_without_limits_of_its_own_is_not_said_to_have_them(harness) -> None:
    it = harness()
    it.sequencer.set_capabilities(resolution_c=0.1, programs_limits=False)
    it.start()
    it.run_until(lambda: it.running)
    (note,) = [note for note in it.notes if note.event == 'limits']
    assert note.details['programmed'] is False
    assert 'set 10 … 35 °C at the chamber' in note.details['warning']
    assert it.limits is None
    it.world['air'] = 36.5  # this program still watches over them
    it.tick()
    assert it.mode == SAFE


def test_the_time_of_a_pause_is_no_time_of_the_dwell(harness) -> None:
    it = harness(at=('hot', DWELL))
    it.sequencer.command('pause')
    it.tick()
    dwelt = it.sequencer.dwelt_s
    for _ in range(50):
        it.tick(9.0)
    it.sequencer.command('resume')
    it.tick(9.0)
    assert it.sequencer.dwelt_s == dwelt


@pytest.mark.parametrize('later', ['pause', 'resume', 'confirm', 'start', 'abort'])
@pytest.mark.parametrize('ending', ['abort', 'standby'])
def test_an_order_to_end_the_run_is_not_taken_back_by_a_later_one(
    harness, ending: str, later: str
) -> None:
    it = harness(at=('hot', DWELL))
    assert it.sequencer.command(ending) == ''
    assert (it.sequencer.command(later) == '') == (later == 'abort')
    it.tick()
    assert it.mode == (SAFE if ending == 'abort' else ABORTED)
