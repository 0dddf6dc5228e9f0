# SPDX-License-Identifier: Apache-2.0
"""How often is a hidden effect named? Confusion, detection, false alarms, fall of the error.

Campaigns come from the simulated device (its own physics); every result is one line of a file,
so that an interrupted run goes on where it stopped.

    python benchmarks/hidden_effects.py --quick
    python benchmarks/hidden_effects.py --seeds 5 --magnitudes 0.3 1 3 -o hidden_effects.jsonl
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import Counter
from pathlib import Path
from typing import Any

os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from imu_driver.simulated_hidden import HIDEABLE, QUALITY
from imu_workbench.experiment_hidden import Secret, practice_campaign
from thermal_comp.diagnose import diagnose
from thermal_comp.effects import EFFECTS

ALARMS = ('effect', 'unexplained', 'unlogged')
QUICK_S = 270.0


def judge(name: str, magnitude: float, seed: int, bias_instability: float) -> dict[str, Any]:
    secrets = [] if name == 'nothing' else [Secret(name, magnitude)]
    recordings, truths = practice_campaign(
        secrets, seed=seed, mean_s=20.0, bias_instability=bias_instability
    )
    start = time.process_time()
    findings = [f.content() for f in diagnose(recordings).findings]
    spent = time.process_time() - start
    truth = truths[0] if truths else None
    alarms = [f for f in findings if f['kind'] in ALARMS]
    first = alarms[0] if alarms else None
    names = {n for f in alarms for n in [f['name'], *f['ambiguous_with']]}
    ratios = [f['error_after'] / f['noise_floor'] for f in alarms if f['error_after']]
    return {
        'name': name,
        'magnitude': magnitude,
        'seed': seed,
        'bias_instability': bias_instability,
        'first': first and (first['name'] or f'{first["kind"]}: {first["depends_on"]}'),
        'in_set': name in names,
        'flagged': bool(alarms) and all(f['name'] is None for f in alarms),
        'variable': bool(first and truth and first['depends_on'] in truth.depends_on),
        'alarms': len(alarms),
        'ratio': max(ratios, default=None),
        'cpu_s': round(spent, 2),
    }


def summary(rows: list[dict[str, Any]]) -> str:
    lines = []
    for magnitude in sorted({r['magnitude'] for r in rows if r['name'] in EFFECTS}):
        part = [r for r in rows if r['name'] in EFFECTS and r['magnitude'] == magnitude]
        first = sum(r['first'] == r['name'] for r in part)
        inside = sum(r['in_set'] for r in part)
        wrong = sum(bool(r['first']) and not r['in_set'] for r in part)
        near = [r for r in part if r['ratio'] is not None]
        fell = sum(r['ratio'] <= 1.05 for r in near)
        lines.append(
            f'M = {magnitude:g}: first {first}/{len(part)}, in set {inside}/{len(part)}, '
            f'wrong {wrong}/{len(part)}, error within 5 % of the floor {fell}/{len(near)}'
        )
        confused = Counter(
            (r['name'], r['first'] or 'nothing') for r in part if r['first'] != r['name']
        )
        lines += [f'    {a} → {b}: {n}' for (a, b), n in confused.most_common()]
    nulls = [r for r in rows if r['name'] == 'nothing']
    lines.append(f'nothing hidden: {sum(r["alarms"] > 0 for r in nulls)}/{len(nulls)} alarms')
    beyond = [r for r in rows if r['name'] not in EFFECTS and r['name'] != 'nothing']
    flagged, named = sum(r['flagged'] for r in beyond), sum(r['variable'] for r in beyond)
    lines.append(
        f'beyond the catalogue or unlogged: {flagged}/{len(beyond)} flagged, '
        f'variable right {named}/{len(beyond)}'
    )
    return '\n'.join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--quick', action='store_true', help='stop after five minutes')
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--magnitudes', type=float, nargs='+', default=[1.0, 3.0])
    parser.add_argument('-o', '--output', type=Path, default=Path('hidden_effects.jsonl'))
    options = parser.parse_args()
    rows = []
    if options.output.exists():
        rows = [json.loads(line) for line in options.output.read_text().splitlines()]
    done = {(r['name'], r['magnitude'], r['seed'], r['bias_instability']) for r in rows}
    magnitudes = [3.0] if options.quick else options.magnitudes
    names = [n for n in HIDEABLE if n not in (*QUALITY, 'clock_temperature', 'nothing')]
    todo = [
        case
        for seed in range(1 if options.quick else options.seeds)
        for case in [
            *(('nothing', 0.0, 900 + 3 * seed + k, b) for k, b in enumerate((0.5, 1.0, 2.0))),
            *((n, m, 100 + seed, 1.0) for m in magnitudes for n in names),
        ]
    ]
    start = time.monotonic()
    with options.output.open('a') as file:
        for case in todo:
            if case in done:
                continue
            if options.quick and time.monotonic() - start > QUICK_S:
                print(f'five minutes are over: {len(rows)} of {len(todo)} campaigns')
                break
            row = judge(*case)
            rows.append(row)
            file.write(json.dumps(row) + '\n')
            file.flush()
            print(f'{row["name"]:<28} M {row["magnitude"]:<4g} → {row["first"] or "nothing"}')
    print(summary(rows))


if __name__ == '__main__':
    main()
