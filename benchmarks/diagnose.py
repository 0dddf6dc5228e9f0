# SPDX-License-Identifier: Apache-2.0
"""How long does a diagnosis of three runs of twelve hours and nine channels take, from the shell?

    python benchmarks/diagnose.py             one sample a second
    python benchmarks/diagnose.py --fast      also a hundred a second (13 million samples)

Bags are simulated once and kept. Wall time is what a user waits, reading and imports included;
processor time says what the same would take alone on a busy machine. Exit code 1 where a claim
does not hold.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from thermal_comp.precompile import precompile

CORES = 2
"""Cores the claims are about."""


@dataclass(frozen=True)
class Claim:
    """What one command may take."""

    label: str
    rate: int
    wall_s: float
    peak_gb: float


CLAIMS = (
    Claim('3 × 12 h at 1 Hz', 1, 5.0, 2.0),
    Claim('3 × 12 h at 100 Hz', 100, 30.0, 2.0),
)
IDLE = (
    'import os, time; a = time.perf_counter(); b = time.process_time(); '
    's = sum(i * i for i in range(3_000_000)); '
    'print((time.perf_counter() - a) / (time.process_time() - b))'
)


def campaign(folder: Path, rate: int) -> list[str]:
    """Return the bags of a campaign, simulated where they are not there."""
    made = folder / f'{rate}_hz'
    if not made.exists():
        print(f'simulating {made} …', flush=True)
        part = folder / f'.{rate}_hz'
        subprocess.run(['rm', '-rf', part], check=True)
        command = ['simulate', 'paper_betta2022', '--device', 'dut2', '--rate', str(rate)]
        workbench([*command, '--seed', '5', '-o', str(part)])
        part.rename(made)
    return [str(made / axis) for axis in 'xyz']


def workbench(arguments: list[str]) -> tuple[float, float, float]:
    """Run a verb; return wall time [s], processor time [s] and peak memory [GB]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    command = [sys.executable, '-m', 'imu_workbench', *arguments]
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    peak = 0.0
    while True:
        peak = max(peak, resident_gb(child.pid))
        try:
            child.wait(0.05)
            break
        except subprocess.TimeoutExpired:
            continue
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if child.returncode:
        raise SystemExit(f'{" ".join(command)} ended with {child.returncode}')
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, spent, peak


def resident_gb(pid: int) -> float:
    """Return the most a process has had in memory so far [GB]."""
    try:
        lines = Path(f'/proc/{pid}/status').read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1e6 for line in lines if line.startswith('VmHWM')), 0.0)


def busy() -> float:
    """Return how much longer than its processor time a plain loop takes here, now."""
    done = subprocess.run([sys.executable, '-c', IDLE], capture_output=True, check=True)
    return float(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--fast', action='store_true', help='also a hundred samples a second')
    parser.add_argument('--folder', type=Path, default=Path('.benchmarks/diagnose'))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    precompile()
    held = True
    print(f'{"":32} {"wall":>8} {"claim":>7} {"cpu":>8} {"peak":>8} {"busy":>6}')
    for claim in CLAIMS:
        if claim.rate > 1 and not options.fast:
            continue
        bags = campaign(options.folder, claim.rate)
        load = busy()
        wall, spent, peak = workbench(['diagnose', *bags])
        # On a busy machine the two cores of the claim would have been this fast at least.
        ok = min(wall, spent) <= claim.wall_s and peak <= claim.peak_gb
        held &= ok
        print(
            f'{claim.label:32} {wall:6.1f} s {claim.wall_s:5.0f} s {spent:6.1f} s '
            f'{peak:5.2f} GB ×{load:4.1f} {"" if ok else "too slow"}',
            flush=True,
        )
    return 0 if held else 1


if __name__ == '__main__':
    sys.exit(main())
