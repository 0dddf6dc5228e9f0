# SPDX-License-Identifier: Apache-2.0
"""The sequencer: the plan is kept, the journal comes first, whatever fails ends in safety."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from chamber_profile.profile import load_profile
from chamber_profile.sequence_types import (
    ABORTED,
    CHECK,
    DONE,
    DWELL,
    HOLD_FAULT,
    IDLE,
    PAUSED,
    RUN,
    SAFE,
    SETTLE,
    Note,
    ProgramLimits,
    Switch,
    WriteSetpoint,
)

SHORT = yaml.safe_load(load_profile('short_20min').text)


def changed(**changes) -> dict:
    return {**SHORT, **changes}


def to_step(bench, name: str, stage: str = '') -> None:
    sequencer = bench.sequencer
    bench.run_until(
        lambda: sequencer.progress.mode == RUN
        and sequencer.step.id == name
        and (not stage or sequencer.progress.stage == stage)
    )


# The plan -------------------------------------------------------------------------------------


def test_nothing_moves_before_start(bench) -> None:
    it = bench()
    for _ in range(1000):
        assert it.tick() == []
    assert it.mode == IDLE


def test_a_run_visits_all_steps_and_ends_done_with_the_chamber_off(bench) -> None:
    it = bench()
    it.start()
    it.run_to_the_end()
    assert it.mode == DONE
    assert not it.running
    visited = [n.progress.step for n in it.notes if n.event in ('run', 'step')]
    assert visited == list(range(len(it.profile.steps)))


def test_limits_are_programmed_before_the_first_setpoint_and_that_before_the_start(bench) -> None:
    it = bench()
    it.start()
    it.run_until(lambda: it.running)
    order = [type(action) for _, action in it.log if not isinstance(action, Note)]
    assert order[:3] == [ProgramLimits, WriteSetpoint, Switch]
    assert it.limits == (10, 35)
    assert it.writes[0][1] == pytest.approx(23.0)  # from where the air is


def test_every_change_is_noted_before_it_takes_effect(bench) -> None:
    it = bench()
    before = it.sequencer.progress
    it.start()
    while it.mode != DONE:
        actions = it.tick()
        now = it.sequencer.progress
        moved = (now.mode, now.step, now.stage) != (before.mode, before.step, before.stage)
        notes = [action for action in actions if isinstance(action, Note)]
        assert not moved or notes
        if notes:
            assert isinstance(actions[0], Note)
            assert notes[-1].progress == replace(now, setpoint=notes[-1].progress.setpoint)
        before = now


@pytest.mark.parametrize('tick_s', [0.5, 1.0])
def test_setpoints_keep_to_the_ideal_ramp_within_rate_and_resolution(bench, tick_s: float) -> None:
    it = bench('paper_betta2022')
    it.start()
    to_step(it, 'cool')
    began = it.time
    written = {}
    while it.sequencer.step.id == 'cool':
        it.tick(tick_s)
        written[it.time] = it.setpoint
    time = np.array(list(written))
    ideal = np.maximum(20.0 - 2.0 / 60.0 * (time - began), -10.0)
    assert np.abs(np.array(list(written.values())) - ideal).max() <= 2.0 / 60 * 2.5 + 0.05 + 1e-9
    assert time[-1] - began == pytest.approx(900, rel=0.01)


def test_setpoints_are_written_at_most_every_five_seconds_and_only_on_change(bench) -> None:
    it = bench()
    it.start()
    it.run_to_the_end()
    time, value = np.array(it.writes).T
    assert np.diff(time).min() >= 5.0
    assert np.abs(np.diff(value)).min() > 0.0


def test_dwells_last_as_the_profile_says_from_when_the_air_is_there(bench) -> None:
    it = bench()
    it.start()
    it.run_to_the_end()
    began = None
    lengths = []
    times = {id(action): time for time, action in it.log}
    for note in it.notes:
        if note.event == 'stage' and note.progress.stage == DWELL:
            began = times[id(note)]
        elif began is not None:
            lengths.append(times[id(note)] - began)
            began = None
    wanted = [step.dwell_s for step in it.profile.steps if step.dwell_s]
    np.testing.assert_allclose(lengths, wanted, rtol=0.01)


def test_a_run_that_ends_away_from_the_safe_temperature_goes_there_first(bench) -> None:
    content = changed(steps=SHORT['steps'][:3], cycles=[])
    it = bench(content)
    it.start()
    it.run_to_the_end()
    assert it.mode == DONE
    assert it.writes[-1][1] == 20.0


# Settling and dwelling ------------------------------------------------------------------------


def test_a_dwell_waits_for_the_device_where_the_profile_says_so(bench) -> None:
    rule = {'source': 'device', 'band_c': 0.5, 'hold_s': 60, 'timeout_s': 3600}
    it = bench(changed(stabilise=rule))
    it.start()
    to_step(it, 'cold', DWELL)
    assert abs(it.device - 15.0) <= 0.5
    assert abs(it.air - 15.0) < 0.05


@pytest.mark.parametrize(
    ('on_timeout', 'mode'), [('abort', SAFE), ('hold', PAUSED), ('continue', RUN)]
)
def test_a_temperature_that_never_settles(bench, on_timeout: str, mode: str) -> None:
    rule = {'band_c': 0.01, 'timeout_s': 300, 'on_timeout': on_timeout, 'hold_s': 3600}
    it = bench(changed(stabilise=rule))
    it.start()
    to_step(it, 'precondition', SETTLE)
    for _ in range(302):
        it.tick()
    if mode == SAFE:  # at 20 °C it is safe at once
        assert 'safe' in it.events
        assert 'not within 0.01 K' in it.sequencer.progress.reason
    else:
        assert it.mode == mode
    if mode == RUN:
        assert it.sequencer.progress.stage == DWELL


@pytest.mark.parametrize(('mode', 'extra'), [('free', 0), ('guaranteed', 60), ('restart', 110)])
def test_the_dwell_clock_while_out_of_band(bench, mode: str, extra: int) -> None:
    it = bench(changed(dwell_mode=mode))
    it.start()
    to_step(it, 'cold', DWELL)
    began = it.time
    for _ in range(50):
        it.tick()
    it.world['air'] = 17.0
    for _ in range(60):
        it.tick()
    del it.world['air']
    it.run_until(lambda: it.sequencer.step.id != 'cold')
    assert it.time - began == pytest.approx(120 + extra, abs=2)


# Operators ------------------------------------------------------------------------------------

POWER_CYCLE = {'id': 'switch', 'kind': 'operator', 'prompt': 'Switch off and on.'}


def with_operator_after(name: str) -> dict:
    steps = list(SHORT['steps'])
    place = next(i for i, step in enumerate(steps) if step['id'] == name) + 1
    return changed(steps=[*steps[:place], POWER_CYCLE, *steps[place:]])


def test_below_ambient_the_chamber_warms_up_before_it_asks_to_be_opened(bench) -> None:
    it = bench(with_operator_after('cold'))
    it.start()
    to_step(it, 'switch')
    assert it.air < 16
    assert it.sequencer.prompt == ''
    it.run_until(lambda: bool(it.sequencer.prompt))
    assert min(it.air, it.device) >= 19.0
    for _ in range(600):
        it.tick()
    assert not it.running
    assert it.sequencer.prompt == 'Switch off and on.'
    assert it.sequencer.command('confirm') == ''
    it.run_to_the_end()
    assert it.mode == DONE


def test_a_pause_stops_the_ramp_and_the_dwell_clock(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'heat')
    for _ in range(100):
        it.tick()
    it.sequencer.command('pause')
    it.tick()
    held = it.sequencer.progress.setpoint
    for _ in range(1000):
        it.tick()
    assert it.mode == PAUSED
    assert it.sequencer.progress.setpoint == held
    assert it.running
    it.sequencer.command('resume')
    it.run_to_the_end()
    assert it.mode == DONE


def test_commands_that_make_no_sense_are_refused_with_the_state(bench) -> None:
    it = bench()
    for name in ('pause', 'resume', 'confirm'):
        assert 'IDLE' in it.sequencer.command(name)
    it.start()
    it.run_until(lambda: it.mode == RUN)
    for name in ('start', 'resume', 'confirm'):
        assert 'RUN' in it.sequencer.command(name)


# Faults ---------------------------------------------------------------------------------------

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
def test_every_fault_leads_to_the_safe_state(bench, fault: str, where: str) -> None:
    it = bench()
    it.start()
    to_step(it, where)
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


def test_the_way_to_the_safe_temperature_keeps_the_safe_rate(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'hot', DWELL)
    it.sequencer.command('abort')
    it.run_to_the_end()
    writes = [(t, v) for t, v in it.writes if v < 30.0][-60:]
    time, value = np.array(writes).T
    falling = np.diff(value) < 0
    assert (np.abs(np.diff(value)) <= 2.0 / 60 * np.diff(time) + 0.1 + 1e-9)[falling].all()
    assert it.mode == ABORTED


def test_a_short_fault_of_the_link_holds_and_goes_on(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'heat')
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


def test_a_write_that_was_lost_is_repeated(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'hot', DWELL)
    it.setpoint = 12.0  # someone else's hand
    it.run_until(lambda: it.setpoint == 30.0, longest_s=30)
    it.obeys = False
    it.setpoint = 12.0
    it.run_until(lambda: it.mode == SAFE, longest_s=120)
    assert '12' in it.sequencer.progress.reason


def test_a_chamber_that_does_not_start_is_given_up(bench) -> None:
    it = bench()
    it.obeys = False
    it.start()
    it.run_to_the_end()
    assert it.mode == ABORTED
    assert 'does not start' in it.sequencer.progress.reason


def test_a_chamber_out_of_reach_in_the_safe_state_is_given_up_in_time(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'hot')
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
        ({'imu_alive': False}, 'IMU'),
        ({'disk_free': 1000}, 'GiB'),
        ({'link': 'failing'}, 'does not answer'),
    ],
)
def test_a_start_is_refused_while_something_is_wrong(bench, world: dict, words: str) -> None:
    it = bench()
    it.world.update(world)
    it.start()
    it.run_until(lambda: it.mode != CHECK, longest_s=60)
    assert it.mode == ABORTED
    assert words in it.sequencer.progress.reason
    assert not it.writes
    assert not it.running


def test_standby_at_once_stops_without_a_ramp(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'hot')
    it.sequencer.command('standby')
    it.tick()
    assert it.mode == ABORTED
    assert not it.running


def test_a_ramp_that_is_too_slow_is_reported_but_goes_on(bench) -> None:
    it = bench('paper_betta2022', lag_s=30.0)
    it.start()
    to_step(it, 'cool')
    it.lag_s = 2500.0  # the compressor is weak
    it.run_until(lambda: it.sequencer.step.id == 'cold')
    report = next(note for note in it.notes if note.event == 'ramp_rate')
    assert abs(report.details['measured']) < 1.6
    assert it.mode == RUN


# Restart --------------------------------------------------------------------------------------


def test_a_restart_reenters_the_step_settles_again_and_dwells_in_full(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'hot', DWELL)
    for _ in range(100):
        it.tick()
    last = it.notes[-1].progress
    again = bench(it.profile, progress=replace(last, mode=IDLE), air=26.0)
    again.setpoint, again.running = 30.0, True
    for _ in range(10):
        assert again.tick() == []
    again.start()
    again.run_until(lambda: again.mode == RUN)
    assert again.sequencer.step.id == 'hot'
    assert again.events == ['start', 'limits', 'interrupted']
    assert again.sequencer.progress.interruptions == 1
    to_step(again, 'hot', DWELL)
    began = again.time
    again.run_until(lambda: again.sequencer.step.id != 'hot')
    assert again.time - began >= 120
    again.run_to_the_end()
    assert again.mode == DONE
    time, value = np.array(again.writes).T
    limit = 2.5 / 60 * np.diff(time) + 0.1
    assert (np.abs(np.diff(value)) <= limit + 1e-9).all()


def test_a_run_that_was_going_to_safety_does_so_after_a_restart(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'hot', DWELL)
    it.sequencer.command('abort')
    it.tick()
    last = it.sequencer.progress
    again = bench(it.profile, progress=replace(last, mode=IDLE), air=30.0)
    again.setpoint, again.running = 30.0, True
    again.start()
    assert again.mode == SAFE
    again.run_to_the_end()
    assert again.mode == ABORTED
    assert not again.running


def test_a_clock_that_jumps_does_not_make_the_setpoint_jump(bench) -> None:
    it = bench()
    it.start()
    to_step(it, 'heat')
    for _ in range(30):
        it.tick()
    before = it.sequencer.progress.setpoint
    it.tick(3600.0)
    assert abs(it.sequencer.progress.setpoint - before) <= 2.5 / 60 * 10 + 1e-9
    it.time -= 7200.0
    here = it.sequencer.progress.setpoint
    it.tick()
    assert it.sequencer.progress.setpoint == here
