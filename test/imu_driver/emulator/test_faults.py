# SPDX-License-Identifier: Apache-2.0
"""Every fault: the session survives, resumes, loses only destroyed samples, and reports them."""

from typing import Any

import numpy as np
import pytest
from imu_driver.board.session import SessionConfig
from imu_driver.emulator.board import BoardOptions
from imu_driver.emulator.faults import FAULTS, FaultError, parse_fault

START, END = 3.0, 5.0
EPOCH = 1_700_000_000_000_000_000


def stamps_of(emulation: Any) -> np.ndarray:
    return (np.array([sample.stamp for sample in emulation.samples]) - EPOCH) * 1e-9


def accelerations(emulation: Any) -> np.ndarray:
    return np.array([sample.linear_acceleration for sample in emulation.samples])


def everything_is_accounted_for(emulation: Any) -> None:
    sequence = emulation.session.sequence
    assert sequence.received + sequence.lost == emulation.line.sent
    assert len(emulation.samples) + emulation.session.discarded == sequence.received
    stamps = stamps_of(emulation)
    assert (np.diff(stamps) > 0).all()
    # Every sample that was published is the one that was measured.
    np.testing.assert_allclose(
        accelerations(emulation), [[0.5, -0.3, 9.79]] * len(stamps), atol=0.006
    )


@pytest.mark.parametrize('protocol', ['binary', 'ascii'])
@pytest.mark.parametrize('fault', sorted(FAULTS))
def test_fault(emulation: Any, fault: str, protocol: str) -> None:
    emulation = emulation(options=BoardOptions(protocol=protocol), faults=(f'{fault}@{START:g}',))
    emulation.run(until=END + 3.0)
    emulation.finish()
    everything_is_accounted_for(emulation)
    stamps = stamps_of(emulation)
    assert np.diff(stamps[stamps < START]).max() < 0.006, 'the line was good until the fault'
    resumed = stamps[stamps > END][0]
    assert resumed < END + (0.5 if fault == 'other_serial' else 0.3)
    assert np.diff(stamps[stamps > END + 1.0]).max() < 0.006, 'and is good after it'
    lost = emulation.session.sequence.lost
    assert lost >= len(emulation.line.damaged) + emulation.line.dropped
    missing = {number for gap in emulation.session.sequence.missing for number in gap}
    if fault not in {'other_serial', 'reset'}:  # there the board counts anew
        assert set(emulation.line.damaged) <= missing
    if fault not in {'unplug', 'other_serial', 'reset'}:
        # A frame is also lost with the delimiter of the one before; the emulator counts that.
        assert lost == len(emulation.line.damaged) + emulation.line.dropped


def test_damage_is_counted_where_it_belongs(emulation: Any) -> None:
    run = emulation(faults=('bit_flips@1+4',))
    run.run(until=6.0)
    run.finish()
    assert len(run.line.damaged) > 10
    assert run.session.counts.errors > 10
    assert run.session.sequence.lost == len(run.line.damaged)


def test_a_reset_is_followed_and_told(emulation: Any) -> None:
    config = SessionConfig(full_scale={'accelerometer': 8.0}, output_data_rate=119.0)
    run = emulation(config=config, faults=(f'reset@{START:g}',))
    run.run(until=END + 2.0)
    assert run.session.restarts == 1
    assert 'the device restarted' in run.events
    assert run.board.full_scale['accelerometer'] == 8.0
    assert run.session.nominal_rate == 119.0
    stamps = stamps_of(run)
    assert END < stamps[stamps > START + 0.1][0] < END + 0.2


def test_an_unplugged_board_goes_on_counting(emulation: Any) -> None:
    run = emulation(faults=(f'unplug@{START:g}',))
    run.run(until=END + 2.0)
    run.finish()
    assert run.connections == 2
    assert run.session.restarts == 0
    # Between the replug and the first retry nothing is read.
    destroyed = run.session.sequence.lost / 238.0
    assert 2.0 <= destroyed < 2.0 + 0.25


def test_the_tick_counter_turns_over(emulation: Any) -> None:
    run = emulation(faults=(f'tick_wrap@{START:g}',))
    run.run(until=END)
    assert run.session.clock.wraps == 1
    assert run.session.restarts == 0
    np.testing.assert_allclose(np.diff(stamps_of(run)), 1 / 238.0, atol=1e-3)


def test_a_wrong_rate_shows_in_the_stamps(emulation: Any) -> None:
    run = emulation(faults=(f'wrong_rate@{START:g}',))
    run.run(until=END + 1.0)
    stamps = stamps_of(run)
    during = np.median(np.diff(stamps[(stamps > START + 0.1) & (stamps < END)]))
    assert during == pytest.approx(1.0 / (0.7 * 238.0), rel=0.01)
    assert run.session.nominal_rate == 238.0


def test_another_scale_is_read_from_the_device(emulation: Any) -> None:
    run = emulation(faults=(f'wrong_scale@{START:g}',))
    run.run(until=END - 0.1)
    assert run.board.full_scale['accelerometer'] == 8.0
    assert run.session.information.full_scale == (245, 8, 4)
    run.run(until=END + 1.0)
    assert run.session.configuration_changes == 2
    assert any('from 245, 2, 4 to 245, 8, 4' in event for event in run.events)
    everything_is_accounted_for(run)


def test_a_scale_that_was_asked_for_is_restored(emulation: Any) -> None:
    config = SessionConfig(full_scale={'accelerometer': 2.0})
    run = emulation(config=config, faults=(f'wrong_scale@{START:g}+60',))
    run.run(until=START + 1.5)
    assert run.board.full_scale['accelerometer'] == 2.0
    everything_is_accounted_for(run)


def test_only_the_wanted_device_is_published(emulation: Any) -> None:
    run = emulation(config=SessionConfig(device='DUT1'), faults=(f'other_serial@{START:g}',))
    run.run(until=START + 1.0)
    assert run.session.refusal == 'device DUT1-OTHER is connected, DUT1 is wanted'
    assert stamps_of(run).max() < START + 0.01
    run.run(until=END + 2.0)
    assert run.session.refusal == ''
    assert stamps_of(run).max() > END + 1.0
    assert 'device DUT1 is accepted' in run.events


def test_any_device_is_published_and_its_change_named(emulation: Any) -> None:
    run = emulation(faults=(f'other_serial@{START:g}',))
    run.run(until=END + 2.0)
    assert run.session.exchanges == 2
    assert 'device DUT1-OTHER took the place of DUT1' in run.events
    stamps = stamps_of(run)
    assert ((stamps > START + 1.0) & (stamps < END)).sum() > 200


def test_another_protocol_version_is_refused(emulation: Any) -> None:
    run = emulation(options=BoardOptions(version=2))
    run.run(until=2.0)
    assert run.session.refusal == 'the device speaks protocol version 2, this driver 1'
    assert run.samples == []


def test_a_sketch_that_only_prints_is_read(emulation: Any) -> None:
    options = BoardOptions(protocol='ascii', minimal=True, output_data_rate=50.0)
    run = emulation(options=options)
    run.run(until=4.0)
    assert run.session.sequence.lost == 0
    assert len(run.samples) == pytest.approx(200, abs=3)
    np.testing.assert_allclose(accelerations(run)[-1], [0.5, -0.3, 9.79], atol=0.006)
    assert any('sends no information' in event for event in run.events)
    refused = emulation(options=options, config=SessionConfig(device='DUT1'))
    refused.run(until=4.0)
    assert 'DUT1 is wanted' in refused.session.refusal
    assert refused.samples == []


def test_a_value_the_board_does_not_have_is_told(emulation: Any) -> None:
    run = emulation(config=SessionConfig(output_data_rate=100.0))
    run.run(until=3.0)
    (told,) = [event for event in run.events if 'did not set' in event]
    assert told == (
        'the device did not set output data rate to 100000: it does not have that value'
    )
    assert len(run.samples) > 400, 'it is read at the rate it has'


def test_new_only_where_newly_measured(emulation: Any) -> None:
    run = emulation()
    run.run(until=5.0)
    with_field = sum(sample.magnetic_field is not None for sample in run.samples)
    with_temperature = sum(sample.temperature is not None for sample in run.samples)
    span = stamps_of(run)[-1] - stamps_of(run)[0]
    assert with_field / span == pytest.approx(80.0, rel=0.02)
    assert with_temperature / span == pytest.approx(59.5, rel=0.02)
    assert run.samples[0].magnetic_field is not None
    assert {s.temperature for s in run.samples if s.temperature is not None} == {20.0}
    np.testing.assert_allclose(
        run.samples[0].magnetic_field, (2.2e-5, -1.1e-5, -4.0e-5), atol=3e-8
    )


@pytest.mark.parametrize('step', [86_400.0, -7_200.0, 3.0])
def test_setting_the_hosts_clock_costs_no_sample(emulation: Any, step: float) -> None:
    run = emulation()
    run.run(until=2.0)
    run.host_ahead = step
    run.run(until=8.0)
    run.finish()
    assert run.session.sequence.lost == 0
    assert run.session.restarts == 0
    assert len(run.samples) == run.line.sent
    assert run.samples[-1].stamp == pytest.approx(run.ns(), abs=50_000_000)


@pytest.mark.parametrize('text', ['flood@3', 'reset', 'reset@x', 'reset@3+', '@3', 'reset@-1'])
def test_a_fault_that_does_not_exist_is_named(text: str) -> None:
    with pytest.raises(FaultError, match='expected NAME@SECONDS'):
        parse_fault(text)
