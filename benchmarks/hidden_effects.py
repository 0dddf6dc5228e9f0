# SPDX-License-Identifier: Apache-2.0
"""How often is a hidden effect named? Confusion, detection, false alarms, fall, coverage.

Campaigns come from the simulated device, whose physics is its own and finer than the catalogue's.
Every campaign is one line of a file, so that an interrupted run goes on where it stopped.

    python benchmarks/hidden_effects.py --quick
    python benchmarks/hidden_effects.py --seeds 5 --magnitudes 3 1 0.3
    python benchmarks/hidden_effects.py --tables .benchmarks/hidden_effects.jsonl
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict
from itertools import chain, islice, zip_longest
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from hidden_effects_tables import tables
from imu_driver.simulation.hidden import CLOCK_TEMPERATURE, DATA_FAULTS, HIDEABLE, NOTHING
from imu_workbench.simulate.hidden_effect import EffectToHide, practice_campaign
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects import EFFECTS
from thermal_comp.precompile import precompile

QUICK_S = 270.0
"""Campaigns started later would end after the five minutes."""
MEAN_S = 20.0
FOLDER = Path('.benchmarks')
PAIRS = (
    ('thermal_lag', 'scale_factor_temperature'),
    ('thermal_hysteresis', 'warm_up'),
    ('bias_temperature_curvature', 'heater_hard_iron'),
    ('supply_sensitivity', 'thermal_lag'),
    ('temperature_rate', 'thermal_hysteresis'),
    ('vibration_rectification', 'bias_drift'),
)
"""Two effects at once, M = 3 each."""
SAME_CHAMBER = 8
"""Seeds that differ by this share a simulated chamber, which is computed once a process."""

Case = tuple[str, float, int, float]
"""Names joined by +, magnitude, seed, factor on the bias instability."""


def judge(case: Case) -> dict[str, Any]:
    """Simulate one campaign, diagnose it; return what was hidden and what was said."""
    name, magnitude, seed, bias_instability = case
    names = [] if name == NOTHING else name.split('+')
    start = time.process_time()
    recordings, truths = practice_campaign(
        [EffectToHide(one, magnitude) for one in names],
        seed=seed,
        mean_s=MEAN_S,
        bias_instability=bias_instability,
    )
    simulated = time.process_time()
    content = diagnose(recordings).to_dict()
    kept = ('kind', 'name', 'sensor', 'ambiguous_with', 'depends_on', 'evidence', 'threshold')
    kept += ('error_before', 'error_after', 'noise_floor', 'parameters')
    return {
        'case': list(case),
        'truths': [asdict(truth) for truth in truths],
        'verdict': content['verdict'],
        'findings': [{key: f.get(key) for key in kept} for f in content['findings']],
        'cpu_s': [round(simulated - start, 2), round(time.process_time() - simulated, 2)],
    }


def cases(magnitudes: Sequence[float], seeds: int, same_chamber: bool) -> list[Case]:
    """Return what is to be done, every kind of table early."""
    hidden = [n for n in HIDEABLE if n not in (*DATA_FAULTS, CLOCK_TEMPERATURE, NOTHING)]
    # Those with shape parameters first: they fill every table.
    known = [n for n in hidden if n in EFFECTS]
    known.sort(key=lambda name: not EFFECTS[name]().shape_parameters)
    beyond = [n for n in hidden if n not in EFFECTS]
    names = [(n, m, 1.0) for m in magnitudes for n in known]
    groups = [names[i : i + len(known)] for i in range(0, len(names), len(known))]
    groups.append([(n, 3.0, 1.0) for n in beyond])
    groups.append([(NOTHING, 0.0, factor) for factor in NULLS])
    groups.append([('+'.join(pair), 3.0, 1.0) for pair in PAIRS])
    kinds = [kind for kind in chain.from_iterable(zip_longest(*groups)) if kind is not None]
    # Every campaign has a device and a draw of noise of its own.
    step = SAME_CHAMBER if same_chamber else 1
    return [
        (name, magnitude, 104 + step * number, factor)
        for number, (name, magnitude, factor) in enumerate(kinds * seeds)
    ]


NULLS = (0.5, 1.0, 2.0)
"""Factors on the bias instability where nothing is hidden."""


def results(todo: Sequence[Case], workers: int, until: float) -> Iterator[dict[str, Any]]:
    """Yield results as they come; start none after `until` [s of the monotonic clock]."""
    # One core per process; numpy reads this when the processes import it.
    os.environ |= {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}
    with ProcessPoolExecutor(workers, mp_context=get_context('spawn')) as pool:
        queue = iter(todo)
        running: set[Future[dict[str, Any]]] = {
            pool.submit(judge, case) for case in islice(queue, workers)
        }
        while running:
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
                case = next(queue, None) if time.monotonic() < until else None
                if case is not None:
                    running.add(pool.submit(judge, case))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--quick', action='store_true', help='stop after five minutes')
    parser.add_argument('--seeds', type=int, default=3)
    parser.add_argument('--magnitudes', type=float, nargs='+', default=[3.0, 1.0, 0.3])
    parser.add_argument('--workers', type=int, default=os.cpu_count())
    parser.add_argument('-o', '--output', type=Path, help='results, one line each')
    parser.add_argument(
        '--tables', type=Path, metavar='FILE', help='only print the tables of FILE'
    )
    options = parser.parse_args()
    start = time.monotonic()
    usual = FOLDER / ('hidden_effects_quick.jsonl' if options.quick else 'hidden_effects.jsonl')
    output = options.tables or options.output or usual
    output.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    if output.exists():
        rows = [json.loads(line) for line in output.read_text('utf-8').splitlines()]
    if options.tables is None:
        precompile()
        done = {tuple(row['case']) for row in rows}
        wanted = cases(options.magnitudes, 1 if options.quick else options.seeds, options.quick)
        todo = [case for case in wanted if case not in done]
        until = start + (QUICK_S if options.quick else 1e9)
        with output.open('a', encoding='utf-8') as file:
            for row in results(todo, options.workers, until):
                rows.append(row)
                file.write(json.dumps(row) + '\n')
                file.flush()
                said = ', '.join(
                    f['name'] or f'{f["kind"]}: {f["depends_on"]}' for f in row['findings']
                )
                name, magnitude, *_ = row['case']
                print(f'{name:<48} M {magnitude:<4g} → {said or "nothing"}', flush=True)
        left = len(todo) - (len(rows) - len(done))
        if left:
            print(f'\n{left} campaigns are left; the same command goes on with them')
    print(f'\n{tables(rows)}\n\n{len(rows)} campaigns, {time.monotonic() - start:.0f} s')


if __name__ == '__main__':
    main()
