# SPDX-License-Identifier: Apache-2.0
"""Real processes over real sockets: a run, an interrupt, a kill at a random moment, a fault."""

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from chamber_profile.journal import read_journal
from chamber_profile.profile import parse_profile

TINY = """\
schema: 1
name: tiny
limits: {air_min_c: 15, air_max_c: 30, rate_max_c_per_min: 3}
stabilise: {source: air, band_c: 0.6, timeout_s: 900}
dwell_mode: guaranteed
steps:
  - {id: precondition, kind: precondition, target_c: 22, rate_c_per_min: 3, dwell_s: 30}
  - {id: heat, kind: ramp, target_c: 26, rate_c_per_min: 3}
  - {id: hot, kind: dwell, dwell_s: 60}
  - {id: return, kind: ramp, target_c: 22, rate_c_per_min: 3}
  - {id: final, kind: final, target_c: 22, rate_c_per_min: 3, dwell_s: 30}
on_abort: {target_c: 22, rate_c_per_min: 3, timeout_s: 600}
"""
PROGRAM = 'import sys; from chamber_profile.{module} import main; sys.exit(main({arguments}))'
pytestmark = pytest.mark.end_to_end


def spawn(module: str, *words: str, argv: bool = True, **options) -> subprocess.Popen:
    """Start a program of the package by its entry function."""
    arguments = repr(list(words)) if argv else ''
    code = PROGRAM.format(module=module, arguments=arguments)
    return subprocess.Popen(
        [sys.executable, '-u', '-c', code, *(() if argv else words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        **options,
    )


class Laboratory:
    """An emulated chamber that lives on while nodes come and go."""

    def __init__(self, folder: Path, time_scale: int = 60, faults: tuple[str, ...] = ()) -> None:
        self.folder = folder
        self.time_scale = time_scale
        self.profile = folder / 'tiny.yaml'
        self.profile.write_text(TINY)
        self.directory = folder / 'run'
        options = [word for fault in faults for word in ('--fault', fault)]
        self.emulator = spawn(
            'emulated_chamber', '--protocol', 'espec', '--tcp', '0',
            '--time-scale', str(time_scale), *options,
        )  # fmt: skip
        self.port = int(re.search(r':(\d+)$', self.emulator.stdout.readline())[1])
        self.nodes: list[subprocess.Popen] = []

    def node(self) -> subprocess.Popen:
        parameters = {
            'chamber': f'espec+tcp://127.0.0.1:{self.port}',
            'profile': self.profile,
            'run_directory': self.directory,
            'time_scale': f'{self.time_scale}.0',
            'start': 'true',
            'require_imu': 'false',
        }
        words = [word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
        process = spawn('node', '--ros-args', *words, argv=False)
        self.nodes.append(process)
        return process

    def until(self, process: subprocess.Popen, words: str) -> None:
        """Read the node's output up to a line with these words."""
        seen = []
        for line in process.stdout:
            seen.append(line)
            if words in line:
                return
        raise AssertionError(f'{words!r} not in {"".join(seen)}')

    def finish(self, process: subprocess.Popen, longest: float = 90.0) -> int:
        process.communicate(timeout=longest)
        return process.returncode

    def journal(self) -> list[dict]:
        return read_journal(self.directory)

    def close(self) -> None:
        for process in (*self.nodes, self.emulator):
            if process.poll() is None:
                process.kill()
            process.communicate()


@pytest.fixture
def laboratory(tmp_path):
    made = []

    def make(**options) -> Laboratory:
        made.append(Laboratory(tmp_path, **options))
        return made[-1]

    yield make
    for laboratory in made:
        laboratory.close()


def dwell_lengths(entries: list[dict], time_scale: int) -> dict[str, float]:
    """Return the last whole dwell of every step [s of the chamber]."""
    lengths = {}
    began = None
    for entry in entries:
        if entry['event'] == 'stage' and entry['stage'] == 'dwell':
            began = entry
        elif began is not None:
            if entry['event'] in ('step', 'stage'):
                passed = (entry['stamp'] - began['stamp']) * 1e-9 * time_scale
                lengths[began['id']] = passed
            began = None
    return lengths


def assert_complete(entries: list[dict], time_scale: int) -> None:
    """The run is done, no dwell was short, no set-point outside the limits."""
    profile = parse_profile(TINY)
    assert entries[-1]['mode'] == 'DONE'
    wanted = {step.id: step.dwell_s for step in profile.run_steps if step.dwell_s}
    lengths = dwell_lengths(entries, time_scale)
    assert set(lengths) == set(wanted)
    for name, length in lengths.items():
        assert length >= 0.97 * wanted[name]
    setpoints = np.array([e['setpoint'] for e in entries if e.get('setpoint') is not None])
    assert setpoints.min() >= profile.limits.air_min_c
    assert setpoints.max() <= profile.limits.air_max_c


def test_a_run_over_tcp_ends_done_and_a_finished_one_is_refused(laboratory) -> None:
    lab = laboratory()
    node = lab.node()
    assert lab.finish(node) == 0
    assert_complete(lab.journal(), lab.time_scale)
    assert lab.finish(lab.node()) == 2


def test_killed_at_random_moments_the_run_still_completes(laboratory) -> None:
    lab = laboratory()
    moments = np.random.default_rng(20)
    for kill in range(3):
        node = lab.node()
        lab.until(node, 'interrupted' if kill else 'run: RUN')
        time.sleep(moments.uniform(0.0, 2.0))  # the moment of the kill is what is tested
        node.kill()
        lab.finish(node)
    assert lab.finish(lab.node()) == 0
    entries = lab.journal()
    assert [entry['event'] for entry in entries].count('interrupted') == 3
    assert_complete(entries, lab.time_scale)


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
    assert (end['stamp'] - safe['stamp']) * 1e-9 * lab.time_scale > 60.0  # a ramp, not a jump


def test_a_second_interrupt_stops_at_once(laboratory) -> None:
    lab = laboratory(time_scale=4)
    node = lab.node()
    lab.until(node, 'run: RUN')
    node.send_signal(signal.SIGINT)
    lab.until(node, 'interrupted')
    time.sleep(0.6)  # two presses of a hand, not two copies of one
    node.send_signal(signal.SIGINT)
    assert lab.finish(node, 10.0) == 1
    last = lab.journal()[-1]
    assert last['mode'] == 'ABORTED'
    assert 'at once' in last['reason']


@pytest.mark.parametrize(
    ('fault', 'code', 'words'),
    [
        ('alarms@4', 1, 'alarm 4'),
        ('operator_stop@4', 1, 'panel'),
        ('disconnect@4', 0, ''),
    ],
)
def test_faults_end_in_safety_or_recovery(laboratory, fault: str, code: int, words: str) -> None:
    lab = laboratory(time_scale=40, faults=(fault,))
    node = lab.node()
    assert lab.finish(node) == code
    last = lab.journal()[-1]
    assert last['mode'] == ('ABORTED' if code else 'DONE')
    assert words in last['reason']
    if not code:
        assert {'hold', 'recovered'} <= {entry['event'] for entry in lab.journal()}
