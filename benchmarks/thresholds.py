# SPDX-License-Identifier: Apache-2.0
"""The evidence effects reach in campaigns in which nothing is hidden.

It has to stay below the evidence from which they are named (`least_evidence` of the effect).

Most campaigns are draws of the noise fitted to simulated devices, on the regressors of their own
simulated campaigns; some go through the whole simulator, whose flicker noise is not of the
model's family. Bias instability varies from half to twice that of the device. Every line of the
file is one batch, so that an interrupted run goes on where it stopped.

    python benchmarks/thresholds.py
"""

from __future__ import annotations

import argparse
import json
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_workbench.simulate.hidden_effect import practice_campaign
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import PreparedRun, prepare
from thermal_comp.diagnosis.candidates import families
from thermal_comp.diagnosis.search import Search
from thermal_comp.diagnosis.thresholds import (
    THRESHOLD_QUANTILE,
    reached_without_effect,
    tail_quantile,
)
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import usable_sensors
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.estimation import fit_noise

FACTORS = (0.5, 1.0, 2.0)
"""On the bias instability."""
EVIDENCE_MARGIN = 5.0
MEAN_S = 20.0
FOLDER = Path('.benchmarks')
LINE = (EFFECTS['bias_temperature'](),)

Reached = dict[str, list[float]]


def campaign(seed: int, factor: float = 1.0) -> list[PreparedRun]:
    """Return a simulated campaign of a device drawn from the class, nothing hidden."""
    recordings, _ = practice_campaign([], seed=seed, mean_s=MEAN_S, bias_instability=factor)
    return prepare(recordings)


def louder(noise: NoiseModel, factor: float) -> NoiseModel:
    """Return the noise with its coloured part multiplied."""
    return replace(noise, amplitudes=noise.amplitudes * factor)


def drawn(seed: int, factor: float, draws: int) -> Reached:
    """Return what effects reach in draws of the noise fitted to a simulated campaign."""
    runs = campaign(seed)
    sensors, _ = usable_sensors(runs)
    noise: dict[Sensor, NoiseModel] = {s: louder(fit_noise(runs, s), factor) for s in sensors}
    lines = dict.fromkeys(sensors, LINE)
    found = reached_without_effect(runs, noise, lines, EFFECTS, draws, seed)
    return {name: values.round(2).tolist() for name, values in found.items()}


def simulated(seed: int, factor: float) -> Reached:
    """Return what effects reach in one campaign that goes through the whole simulator."""
    runs = campaign(seed, factor)
    source = ColumnSource(runs)
    reached: Reached = defaultdict(list)
    for sensor in usable_sensors(runs)[0]:
        design = CandidateDesign(source, sensor, fit_noise(runs, sensor), LINE)
        for rated in Search(design, families(design, EFFECTS)).ranking([]):
            reached[rated.name].append(round(rated.evidence, 2))
    return dict(reached)


def batches(campaigns: int, draws: int, simulations: int) -> Iterator[dict[str, Any]]:
    """Yield what is to be done, in an order that makes every part grow."""
    for number in range(max(campaigns, simulations)):
        for factor in FACTORS:
            if number < campaigns:
                yield {'kind': 'drawn', 'seed': 700 + number, 'factor': factor, 'draws': draws}
            if number < simulations:
                yield {'kind': 'simulated', 'seed': 800 + number, 'factor': factor, 'draws': 1}


def thresholds(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return the evidence noise alone asks for: tail quantile over all sensors, plus a margin.

    Campaigns through the whole simulator are too few for a quantile: their largest counts.
    """
    drawn_: Reached = defaultdict(list)
    largest: dict[str, float] = defaultdict(lambda: -np.inf)
    for row in rows:
        for name, values in row['reached'].items():
            if row['batch']['kind'] == 'drawn':
                drawn_[name] += values
            largest[name] = max(largest[name], *values)
    table: dict[str, float] = {}
    for name, values in drawn_.items():
        tail = tail_quantile(np.array(values), THRESHOLD_QUANTILE)
        table[name] = EVIDENCE_MARGIN + max(tail, largest[name])
    return table


def described(rows: Sequence[dict[str, Any]]) -> str:
    """Return how many campaigns the table rests on."""
    count = {
        kind: sum(r['batch']['draws'] for r in rows if r['batch']['kind'] == kind)
        for kind in ('drawn', 'simulated')
    }
    return (
        f'{count["drawn"]} campaigns of drawn noise, {count["simulated"]} through the simulator, '
        f'bias instability × {", ".join(f"{f:g}" for f in FACTORS)}'
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--campaigns', type=int, default=4, help='of which noise is drawn')
    parser.add_argument('--draws', type=int, default=40, help='of each at each bias instability')
    parser.add_argument('--simulations', type=int, default=8, help='at each bias instability')
    parser.add_argument('-o', '--output', type=Path, default=FOLDER / 'thresholds.jsonl')
    options = parser.parse_args()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    if options.output.exists():
        rows = [json.loads(line) for line in options.output.read_text('utf-8').splitlines()]
    done = [row['batch'] for row in rows]
    with options.output.open('a', encoding='utf-8') as file:
        for batch in batches(options.campaigns, options.draws, options.simulations):
            if batch in done:
                continue
            start = time.process_time()
            if batch['kind'] == 'drawn':
                reached = drawn(batch['seed'], batch['factor'], batch['draws'])
            else:
                reached = simulated(batch['seed'], batch['factor'])
            rows.append({'batch': batch, 'reached': reached})
            file.write(json.dumps(rows[-1]) + '\n')
            file.flush()
            print(f'{batch} {time.process_time() - start:.0f} s', flush=True)
    table = thresholds(rows)
    for name in sorted(table, key=lambda n: -table[n]):
        values = [v for row in rows for v in row['reached'].get(name, [])]
        largest = f'{max(values):7.1f}' if values else '   none'
        needed = EFFECTS[name].least_evidence
        told = 'enough' if table[name] <= needed else f'raise it to {np.ceil(table[name]):.0f}'
        print(f'{name:<28} n {len(values):5} largest {largest}, named from {needed:g}: {told}')
    print(described(rows))


if __name__ == '__main__':
    main()
