# SPDX-License-Identifier: Apache-2.0
"""How often does a device without a hidden effect stay clean, by shipped profile and rate?

Campaigns are those of `simulate PROFILE --rate RATE --seed SEED`: three orientations of dut1, dut2
and dut3 in turn, single samples. From DIRECT_RATE_HZ on the simulated sensor paces them by its own
clock, which drifts: that slope, where it is found as it is, is true and no false name. One JSON
line each, so that an interrupted run goes on where it stopped. The claim is 98 % of all; exit code
1 where it fails, or nothing was run.

    python benchmarks/profile_nulls.py --seeds 20
    python benchmarks/profile_nulls.py --profiles short_20min --rates 5 50 100 --seconds 600
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from chamber_profile.profile.file import profile_names
from imu_driver.simulation.devices import DEVICES
from imu_driver.simulation.read_out import DIRECT_RATE_HZ
from imu_recording.user_error import UserError
from imu_workbench.simulate.campaign import Logging, simulate_campaign
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.diagnosis.result import Finding
from thermal_comp.precompile import precompile
from verdict import Verdict, judge

CLEAN = 0.98
TURNS = ('dut1', 'dut2', 'dut3')
CLOCK_ERROR = 0.1
"""Of a slope of the clock that counts as found."""
MOST_ROWS = 7_000_000
"""Rows of a campaign; a rate that makes more of a profile is left out and named."""


def trial(profile: str, rate: float, seed: int) -> dict[str, Any]:
    """Return what is said of a campaign without a hidden effect."""
    row: dict[str, Any] = {'profile': profile, 'rate': rate, 'seed': seed}
    device = TURNS[seed % len(TURNS)]
    slow = simulate_campaign(profile, device, Logging(0.1), seed=seed)
    if sum(len(run) for run in slow) * rate / 0.1 > MOST_ROWS:
        return row | {'verdict': 'too long', 'findings': []}
    recordings = simulate_campaign(profile, device, Logging(rate), seed=seed)
    try:
        found = diagnose(recordings)
    except UserError as error:
        return row | {'verdict': 'refused', 'findings': [str(error)]}
    said = [
        f'{f.name or f.depends_on} ({f.sensor})'
        for f in found.findings
        if f.kind != 'noise' and not _true_clock(f, device, rate)
    ]
    return row | {'verdict': 'named' if said else 'clean', 'findings': said}


def _true_clock(finding: Finding, device: str, rate: float) -> bool:
    """Tell whether a finding is the slope that the clock of the simulated sensor has."""
    if finding.name != 'clock_temperature' or rate < DIRECT_RATE_HZ:
        return False
    slope = -DEVICES[device].rate_slope  # a faster clock makes shorter intervals
    return abs(finding.parameters['slope']['value'] - slope) < CLOCK_ERROR * abs(slope)


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return clean campaigns of all, by profile and rate, and what was said of the others."""
    lines = []
    for profile, rate in dict.fromkeys((row['profile'], row['rate']) for row in rows):
        own = [row for row in rows if (row['profile'], row['rate']) == (profile, rate)]
        judged = [row for row in own if row['verdict'] != 'too long']
        clean = sum(row['verdict'] == 'clean' for row in judged)
        said = f'{clean} of {len(judged)}' if judged else 'not run: too many rows'
        lines.append(f'{profile:<24}{rate:>6g} Hz  {said}')
        lines += [
            f'    seed {row["seed"]}: {row["verdict"]}: {row["findings"]}'
            for row in judged
            if row['verdict'] != 'clean'
        ]
    return '\n'.join(lines)


def main() -> int:
    """Run what was not run before; print the table and the claim."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=10)
    parser.add_argument('--rates', type=float, nargs='+', default=[0.5, 1.0, 5.0, 50.0, 100.0])
    parser.add_argument('--profiles', nargs='+', default=profile_names())
    parser.add_argument('--seconds', type=float, default=1e9, help='start none after this time')
    parser.add_argument(
        '-o', '--output', type=Path, default=Path('.benchmarks/profile_nulls.jsonl')
    )
    options = parser.parse_args()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.touch()
    rows = [json.loads(line) for line in options.output.read_text('utf-8').splitlines()]
    done = {(row['profile'], row['rate'], row['seed']) for row in rows}
    precompile()
    began = time.monotonic()
    with options.output.open('a', encoding='utf-8') as log:
        for seed in range(1, options.seeds + 1):
            for profile in options.profiles:
                for rate in options.rates:
                    late = time.monotonic() - began > options.seconds
                    if late or (profile, rate, seed) in done:
                        continue
                    rows.append(trial(profile, rate, seed))
                    log.write(json.dumps(rows[-1]) + '\n')
                    log.flush()
    print(table(rows))
    judged = [row for row in rows if row['verdict'] != 'too long']
    clean = sum(row['verdict'] == 'clean' for row in judged)
    share = clean / len(judged) if judged else 0.0
    claim = f'nothing is missing, {len(judged)} campaigns'
    return bool(judge([Verdict(claim, share, CLEAN, at_least=True)]))


if __name__ == '__main__':
    sys.exit(main())
