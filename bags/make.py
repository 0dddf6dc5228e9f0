# SPDX-License-Identifier: Apache-2.0
"""Make the bags of this folder anew, and the table in README.md that names their columns' hashes.

`python bags/make.py` makes all of them, `python bags/make.py dut1_x …` the named ones, into this
folder or `--output DIR`; `--check` makes nothing and compares the bags with README.md.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from functools import lru_cache
from pathlib import Path

from imu_recording.recording import columns_hash
from imu_workbench.simulate.campaign import Logging, simulate_run
from imu_workbench.simulate.hidden_effect import (
    BUNDLED_TRUTH_FILE,
    EffectToHide,
    SimulatedCampaign,
    hidden_campaign,
    write_truth,
)
from imu_workbench.simulate.motion import simulate_motion

from imu_recording import ImuRecording, read_bag, write_bag

HERE = Path(__file__).resolve().parent
PROFILE = 'paper_betta2022'
CHAMBER_PERIOD = 10.0
RUNS = {f'dut{k}_{axis}': (f'dut{k}', axis) for k in (1, 2, 3) for axis in 'xyz'}
SEEDS = {'dut1': 1, 'dut2': 2, 'dut3': 3}
MOTION = 'dut1_motion'
MOTION_SEED = 4
SECRET = {f'hidden_effect_{axis}': k for k, axis in enumerate('xyz')}
SECRET_DEVICE, SECRET_SEED, SECRET_MAGNITUDE, SECRET_RATE = 'dut2', 133, 5.0, 0.1
NAMES = (*RUNS, MOTION, *SECRET)


def command(name: str) -> str:
    """Return the command that makes the same bag."""
    if name == MOTION:
        return f'python bags/make.py {MOTION}'
    if name in SECRET:
        return (
            f'python -m imu_workbench simulate {PROFILE} --device {SECRET_DEVICE} --hide random '
            f'--magnitude {SECRET_MAGNITUDE:g} --rate {SECRET_RATE:g} '
            f'--chamber-period {CHAMBER_PERIOD:g} --seed {SECRET_SEED} -o hidden_effect '
            f'(its bag {name[-1]})'
        )
    device, axis = RUNS[name]
    return (
        f'python -m imu_workbench simulate {PROFILE} --device {device} --orientation {axis} '
        f'--rate 0.5 --chamber-period {CHAMBER_PERIOD:g} --seed {SEEDS[device]} -o bags/{name}'
    )


def seed(name: str) -> int:
    """Return the seed of a bag."""
    if name in SECRET:
        return SECRET_SEED
    return MOTION_SEED if name == MOTION else SEEDS[RUNS[name][0]]


@lru_cache
def secret_campaign() -> SimulatedCampaign:
    """Return the campaign with the hidden effect."""
    return hidden_campaign(
        PROFILE,
        SECRET_DEVICE,
        Logging(SECRET_RATE, True, CHAMBER_PERIOD),
        [EffectToHide('random', SECRET_MAGNITUDE)],
        seed=SECRET_SEED,
    )


def made(name: str) -> ImuRecording:
    """Return the recording of a bag, simulated anew."""
    if name == MOTION:
        return simulate_motion(
            'dut1', rate_hz=100.0, seed=MOTION_SEED, chamber_period=CHAMBER_PERIOD
        )
    if name in SECRET:
        return secret_campaign().recordings[SECRET[name]]
    device, axis = RUNS[name]
    logging = Logging(0.5, chamber_period=CHAMBER_PERIOD)
    return simulate_run(PROFILE, device, logging, seed=SEEDS[device], orientation=f'+{axis}')


def row(name: str, recording: ImuRecording) -> str:
    """Return the bag's row of the table in README.md."""
    hours = recording.time[-1] / 3600.0
    return (
        f'| `{name}` | {hours:.2f} h | {len(recording)} | {seed(name)} | '
        f'`{columns_hash(recording)}` | `{command(name)}` |'
    )


def hashes() -> dict[str, str]:
    """Return the hash of every bag that README.md states."""
    text = (HERE / 'README.md').read_text(encoding='utf-8')
    return dict(re.findall(r'^\| `(\w+)` \|.*?`([0-9a-f]{64})`', text, flags=re.MULTILINE))


def check() -> int:
    """Compare every bag's columns with the hash in README.md; return the exit code."""
    stated = hashes()
    wrong = [name for name in NAMES if columns_hash(read_bag(HERE / name)) != stated.get(name)]
    good = len(NAMES) - len(wrong)
    sys.stdout.write(f'{good} bags as stated in README.md; different: {wrong or "none"}\n')
    return 1 if wrong else 0


def make(names: list[str], output: Path) -> None:
    """Write the bags; into this folder, README.md's rows are renewed as well."""
    readme = HERE / 'README.md'
    for name in names:
        recording = made(name)
        shutil.rmtree(output / name, ignore_errors=True)
        write_bag(recording, output / name)
        if name in SECRET:
            write_truth(
                output / BUNDLED_TRUTH_FILE,
                secret_campaign(),
                device=SECRET_DEVICE,
                seed=SECRET_SEED,
                profile=PROFILE,
                bags=list(SECRET),
            )
        line = row(name, read_bag(output / name))
        sys.stdout.write(line + '\n')
        if output == HERE:
            text = readme.read_text(encoding='utf-8')
            renewed = re.sub(rf'^\| `{name}` \|.*$', line, text, flags=re.MULTILINE)
            readme.write_text(renewed, encoding='utf-8')


def main() -> int:
    """Make or check the bags."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', metavar='NAME', help=f'of {", ".join(NAMES)}')
    parser.add_argument('--output', type=Path, default=HERE, help='folder to write to')
    parser.add_argument('--check', action='store_true', help='compare hashes with README.md')
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(NAMES))
    if unknown:
        parser.error(f'no bag {unknown[0]}; there are {", ".join(NAMES)}')
    if options.check:
        return check()
    make(options.names or list(NAMES), options.output.resolve())
    return 0


if __name__ == '__main__':
    sys.exit(main())
