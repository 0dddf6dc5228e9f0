# SPDX-License-Identifier: Apache-2.0
"""Real processes over real sockets: a run, an interrupt, a kill at a random moment, a fault."""

import signal
import time

import numpy as np
import pytest
from laboratory import assert_complete

pytestmark = pytest.mark.end_to_end


def test_a_run_over_tcp_ends_done_and_a_finished_one_is_refused(laboratory) -> None:
    lab = laboratory(time_scale=150)
    node = lab.node()
    assert lab.finish(node) == 0
    assert_complete(lab.journal())
    assert lab.finish(lab.node()) == 2


def test_killed_at_random_moments_the_run_still_completes(laboratory) -> None:
    lab = laboratory()
    moments = np.random.default_rng(20)
    for kill in range(2):
        node = lab.node()
        lab.until(node, 'interrupted' if kill else 'run: RUN')
        time.sleep(moments.uniform(0.0, 2.0))  # the moment of the kill is what is tested
        node.kill()
        lab.finish(node)
    assert lab.finish(lab.node()) == 0
    entries = lab.journal()
    assert [entry['event'] for entry in entries].count('interrupted') == 2
    assert_complete(entries)


def test_one_interrupt_goes_to_the_safe_temperature_even_if_it_arrives_twice(laboratory) -> None:
    lab = laboratory()
    node = lab.node()
    lab.until(node, 'step: RUN hot')
    node.send_signal(signal.SIGINT)
    node.send_signal(signal.SIGINT)  # the terminal's and the launcher's copy of one Ctrl-C
    assert lab.finish(node) == 1
    modes = [entry.get('mode') for entry in lab.journal()]
    assert 'SAFE' in modes
    assert modes[-1] == 'ABORTED'
    safe, end = (next(e for e in lab.journal() if e.get('mode') == m) for m in ('SAFE', 'ABORTED'))
    assert abs(end['setpoint'] - 22.0) < 0.01
    assert end['clock_s'] - safe['clock_s'] > 60.0  # a ramp, not a jump


def test_a_second_interrupt_stops_at_once(laboratory) -> None:
    lab = laboratory(time_scale=4)
    node = lab.node()
    lab.until(node, 'run: RUN')
    node.send_signal(signal.SIGINT)
    lab.until(node, 'interrupted')
    time.sleep(0.6)  # two presses of a hand, not two copies of one
    node.send_signal(signal.SIGINT)
    assert lab.finish(node) == 1
    last = lab.journal()[-1]
    assert last['mode'] == 'ABORTED'
    assert 'at once' in last['reason']


@pytest.mark.parametrize(
    ('fault', 'code', 'words'),
    [
        ('alarms@2', 1, 'alarm 4'),
        pytest.param('operator_stop@2', 1, 'panel', marks=pytest.mark.long),
        ('disconnect@2', 0, ''),
    ],
)
def test_faults_end_in_safety_or_recovery(laboratory, fault: str, code: int, words: str) -> None:
    lab = laboratory(time_scale=80, faults=(fault,))
    node = lab.node()
    assert lab.finish(node) == code
    last = lab.journal()[-1]
    assert last['mode'] == ('ABORTED' if code else 'DONE')
    assert words in last['reason']
    if not code:
        assert {'hold', 'recovered'} <= {entry['event'] for entry in lab.journal()}
