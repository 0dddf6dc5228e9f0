# SPDX-License-Identifier: Apache-2.0
"""The sequencer: the plan is kept, the journal comes first, whatever fails ends in safety."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from chamber_profile.profile.file import load_profile
from chamber_profile.profile.unroll import campaign_steps
from chamber_profile.run.values import (
    DONE,
    DWELL,
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


# The plan -------------------------------------------------------------------------------------


def test_nothing_moves_before_start(harness) -> None:
    it = harness()
    for _ in range(1000):
        assert it.tick() == []
    assert it.mode == IDLE


def test_a_run_visits_all_steps_and_ends_done_with_the_chamber_off(harness) -> None:
    it = harness()
    it.start()
    it.run_to_the_end()
    assert it.mode == DONE
    assert not it.running
    visited = [n.progress.step for n in it.notes if n.event in ('run', 'step')]
    assert visited == list(range(len(campaign_steps(it.profile))))


def test_limits_come_before_the_first_setpoint_and_that_before_the_start(
    harness,
) -> None:
    it = harness()
    it.start()
    it.run_until(lambda: it.running)
    order = [type(action) for _, action in it.log if not isinstance(action, Note)]
    assert order[:3] == [ProgramLimits, WriteSetpoint, Switch]
    assert it.limits == (10, 35)
    assert it.writes[0][1] == pytest.approx(23.0)  # from where the air is


def test_every_change_is_noted_before_it_takes_effect(harness) -> None:
    it = harness()
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
def test_setpoints_follow_the_ideal_ramp_within_rate_and_resolution(
    harness, tick_s: float
) -> None:
    it = harness('paper_betta2022')
    it.start()
    it.to_step('cool')
    began = it.time
    written = {}
    while it.sequencer.step.id == 'cool':
        it.tick(tick_s)
        written[it.time] = it.setpoint
    time = np.array(list(written))
    ideal = np.maximum(20.0 - 2.0 / 60.0 * (time - began), -10.0)
    assert np.abs(np.array(list(written.values())) - ideal).max() <= 2.0 / 60 * 2.5 + 0.05 + 1e-9
    assert time[-1] - began == pytest.approx(900, rel=0.01)


def test_setpoints_are_written_at_most_every_five_seconds_and_only_on_change(harness) -> None:
    it = harness()
    it.start()
    it.run_to_the_end()
    time, value = np.array(it.writes).T
    assert np.diff(time).min() >= 5.0
    assert np.abs(np.diff(value)).min() > 0.0


def test_dwells_last_as_the_profile_says_from_when_the_air_is_there(harness) -> None:
    it = harness()
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
    wanted = [step.dwell_s for step in campaign_steps(it.profile) if step.dwell_s]
    np.testing.assert_allclose(lengths, wanted, rtol=0.01)


def test_a_run_that_ends_away_from_the_safe_temperature_goes_there_first(harness) -> None:
    content = changed(steps=SHORT['steps'][:3], cycles=[])
    it = harness(content)
    it.start()
    it.run_to_the_end()
    assert it.mode == DONE
    assert it.writes[-1][1] == 20.0


# Settling and dwelling ---------------------------------------------------------------------


def test_a_dwell_waits_for_the_device_where_the_profile_says_so(harness) -> None:
    rule = {'source': 'device', 'band_c': 0.5, 'hold_s': 60, 'timeout_s': 3600}
    it = harness(changed(stabilise=rule))
    it.start()
    it.to_step('cold', DWELL)
    assert abs(it.device - 15.0) <= 0.5
    assert abs(it.air - 15.0) < 0.05


@pytest.mark.parametrize(
    ('on_timeout', 'mode'), [('abort', SAFE), ('hold', PAUSED), ('continue', RUN)]
)
def test_a_temperature_that_never_settles(harness, on_timeout: str, mode: str) -> None:
    rule = {'band_c': 0.01, 'timeout_s': 300, 'on_timeout': on_timeout, 'hold_s': 3600}
    it = harness(changed(stabilise=rule))
    it.start()
    it.to_step('precondition', SETTLE)
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
def test_the_dwell_clock_while_out_of_band(harness, mode: str, extra: int) -> None:
    it = harness(changed(dwell_mode=mode))
    it.start()
    it.to_step('cold', DWELL)
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


def test_below_ambient_the_chamber_warms_up_before_it_asks_to_be_opened(harness) -> None:
    it = harness(with_operator_after('cold'))
    it.start()
    it.to_step('switch')
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


def test_a_pause_stops_the_ramp_and_the_dwell_clock(harness) -> None:
    it = harness(at=('heat',))
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


def test_commands_that_make_no_sense_are_refused_with_the_state(harness) -> None:
    it = harness()
    for name in ('pause', 'resume', 'confirm'):
        assert 'IDLE' in it.sequencer.command(name)
    it.start()
    it.run_until(lambda: it.mode == RUN)
    for name in ('start', 'resume', 'confirm'):
        assert 'RUN' in it.sequencer.command(name)
