# SPDX-License-Identifier: Apache-2.0
"""Real processes over real sockets: an emulated chamber, nodes that come and go, a recorder."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
from chamber_profile.profile.file import parse_profile
from chamber_profile.run.journal import read_journal

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
PROGRAM = 'import sys; from {module} import main; sys.exit(main({arguments}))'
DOMAIN = 215 + int(os.environ['ROS_DOMAIN_ID']) % 17
"""Of ROS: beside those that other tests choose, and clear of the system's own ports."""


class Laboratory:
    """An emulated chamber that lives on while nodes come and go."""

    def __init__(
        self,
        folder: Path,
        time_scale: int = 60,
        faults: tuple[str, ...] = (),
        profile: str = TINY,
    ) -> None:
        self.folder = folder
        self.time_scale = time_scale
        self.profile = folder / 'profile.yaml'
        self.profile.write_text(profile)
        self.directory = folder / 'run'
        self.processes: list[subprocess.Popen] = []
        options = [word for fault in faults for word in ('--fault', fault)]
        words = ['--protocol', 'espec', '--tcp', '0', '--time-scale', str(time_scale), *options]
        emulator = self._spawn('chamber_profile.emulators.chamber', repr(words))
        self.port = int(re.search(r':(\d+)$', emulator.stdout.readline())[1])

    def node(self) -> subprocess.Popen:
        """Start a chamber node that begins or resumes the run."""
        return self.start(
            'chamber_profile.node',
            chamber=f'espec+tcp://127.0.0.1:{self.port}',
            profile=self.profile,
            run_directory=self.directory,
            time_scale=f'{self.time_scale}.0',
            start='true',
            require_imu='false',
        )

    def start(self, module: str, **parameters) -> subprocess.Popen:
        """Start a node by its module."""
        words = [word for key, value in parameters.items() for word in ('-p', f'{key}:={value}')]
        return self._spawn(module, '', '--ros-args', *words)

    def _spawn(self, module: str, arguments: str, *words: str) -> subprocess.Popen:
        code = PROGRAM.format(module=module, arguments=arguments)
        process = subprocess.Popen(
            [sys.executable, '-u', '-c', code, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN)},
        )
        self.processes.append(process)
        return process

    def until(self, process: subprocess.Popen, words: str, longest: float = 180.0) -> None:
        """Read the node's output up to a line with these words."""
        seen = []
        patience = threading.Timer(longest, process.kill)  # which ends its output
        patience.start()
        try:
            for line in process.stdout:
                seen.append(line)
                if words in line:
                    return
        finally:
            patience.cancel()
        raise AssertionError(f'{words!r} not in {"".join(seen)}')

    def finish(self, process: subprocess.Popen, longest: float = 180.0) -> int:
        """Wait for its end and return its exit code."""
        process.communicate(timeout=longest)
        return process.returncode

    def journal(self) -> list[dict]:
        """Return what the run has noted."""
        return read_journal(self.directory)

    def close(self) -> None:
        """Kill what still runs."""
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.communicate()


def dwell_lengths(entries: list[dict]) -> dict[str, float]:
    """Return the last whole dwell of every step [s of the chamber]."""
    lengths = {}
    began = None
    for entry in entries:
        if entry['event'] == 'stage' and entry['stage'] == 'dwell':
            began = entry
        elif began is not None:
            if entry['event'] in ('step', 'stage'):
                lengths[began['id']] = entry['clock_s'] - began['clock_s']
            began = None
    return lengths


def assert_complete(entries: list[dict]) -> None:
    """The run is done, no dwell was short, no set-point outside the limits."""
    profile = parse_profile(TINY)
    assert entries[-1]['mode'] == 'DONE', entries[-1]
    wanted = {step.id: step.dwell_s for step in profile.run_steps if step.dwell_s}
    lengths = dwell_lengths(entries)
    assert set(lengths) == set(wanted)
    for name, length in lengths.items():
        assert length >= wanted[name] - 0.002, name
    setpoints = np.array([e['setpoint'] for e in entries if e.get('setpoint') is not None])
    assert setpoints.min() >= profile.limits.air_min_c
    assert setpoints.max() <= profile.limits.air_max_c
