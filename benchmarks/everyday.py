# SPDX-License-Identifier: Apache-2.0
"""How good are explanations and corrections on campaigns as people make them?

Every seed is one campaign: of twelve kinds of the independent simulator, and three of the
project's own. Each is fitted and diagnosed without a look at the truth, which is kept beside the
answer in one JSON line, so that an interrupted run goes on where it stopped.

    python benchmarks/everyday.py --quick
    python benchmarks/everyday.py --seeds 0..1000 --jobs 2 -o .benchmarks/everyday.jsonl
    python benchmarks/everyday.py --tables .benchmarks/everyday.jsonl
    python benchmarks/everyday.py --sealed --seeds 900000..900150

Seeds from 900 000 on are sealed: they are run once, when nothing is changed any more.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from everyday_tables import tables
from imu_driver.simulation.devices import draw_device
from imu_driver.simulation.hidden import HIDDEN_EFFECTS, UNLOGGED_EFFECTS
from imu_recording.recording import ImuRecording
from imu_recording.user_error import UserError
from imu_workbench.simulate.campaign import Logging
from imu_workbench.simulate.hidden_effect import EffectToHide, SimulatedCampaign, hidden_campaign
from independent_simulator.campaign import COUNTS, MAGNITUDES, MOST_UNEQUAL, SEALED, draw_campaign
from independent_simulator.scenarios import SCENARIOS
from thermal_comp.data.preparation import prepare
from thermal_comp.data.quality import check_quality
from thermal_comp.diagnosis.diagnose import Settings
from thermal_comp.diagnosis.growth import grow
from thermal_comp.effects import EFFECTS
from thermal_comp.precompile import precompile

import thermal_comp as tc

QUICK_S = 200.0
"""Campaigns started later would end after the few minutes."""
FOLDER = Path('.benchmarks')
OWN = {
    'own_laboratory': ('paper_betta2022', ('+x', '+y', '+z'), Logging(0.05, True, 20.0)),
    'own_one_pose': ('paper_betta2022', ('+z',), Logging(0.05, True, 20.0)),
    'own_20min': ('short_20min', ('+z',), Logging(1.0, True, 1.0)),
}
"""Kinds of the project's own simulator: profile, orientations, rows."""
KINDS = (*SCENARIOS, *OWN)
SPARE = ('supply_voltage', 'humidity', 'fan', 'heater', 'compressor', 'vibration')
"""Channels that no more than one effect needs."""
FINDING = (
    'kind', 'name', 'sensor', 'ambiguous_with', 'depends_on', 'evidence', 'threshold',
    'error_before', 'error_after', 'noise_floor', 'parameters', 'probability',
)  # fmt: skip
Truth = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A campaign, its truth for the score, and the hidden part of the error where it is known."""

    recordings: Sequence[ImuRecording]
    truth: Truth
    hidden: Sequence[Sequence[Mapping[str, np.ndarray]]] = ()
    """Per effect, run and sensor (n, 3)."""


def kind_of(seed: int) -> str:
    return KINDS[seed % len(KINDS)]


def campaign(seed: int) -> Case:
    """Return the campaign of a seed."""
    kind = kind_of(seed)
    if kind in OWN:
        return _own(seed, kind)
    drawn = draw_campaign(seed, kind)
    truth = drawn.truth.to_dict() | {'simulator': 'independent'}
    return Case(drawn.recordings, truth, drawn.truth.hidden)


def _own(seed: int, kind: str) -> Case:
    """Return a campaign of the project's simulator, drawn like the independent one's."""
    profile, orientations, logging = OWN[kind]

    def made(effects: Sequence[EffectToHide]) -> SimulatedCampaign:
        return hidden_campaign(
            profile, draw_device(seed), logging, effects, seed=seed, orientations=orientations
        )

    rng = np.random.default_rng([seed, 5])
    count = int(rng.choice(list(COUNTS), p=list(COUNTS.values())))
    wanted: list[EffectToHide] = []
    for one in _wishes(rng, count):
        if len(wanted) < abs(count):
            with suppress(UserError):  # the profile does not excite it
                made([one])
                wanted.append(one)
    drawn = made(wanted)
    effects = [
        {
            'name': truth.name or truth.law,
            'sensors': truth.sensor.split('+') if truth.sensor else [],
            'magnitude': truth.magnitude,
            'parameters': truth.parameters,
            'in_catalogue': truth.kind != 'unexplained',
            'logged': truth.kind != 'unlogged',
        }
        for truth in drawn.truths
        if truth.kind != 'nothing'
    ]
    unlogged = any(not effect['logged'] for effect in effects)
    truth = {'seed': seed, 'scenario': kind, 'simulator': 'own', 'effects': effects}
    return Case(drawn.recordings, truth | {'unlogged': unlogged})


def _wishes(rng: np.random.Generator, count: int) -> Iterator[EffectToHide]:
    """Yield all that could be hidden, each law once, in random order, the largest first."""
    laws = {**HIDDEN_EFFECTS, **UNLOGGED_EFFECTS}
    kind = 'effect' if count >= 0 else 'unexplained'
    size = float(np.exp(rng.uniform(*np.log(MAGNITUDES))))
    taken: set[str] = set()
    for name in rng.permutation([n for n, law in laws.items() if law.kind == kind]):
        law = laws[str(name)].name
        if law not in taken:
            unequal = float(np.exp(rng.uniform(0.0, np.log(MOST_UNEQUAL)))) if taken else 1.0
            yield EffectToHide(str(name), max(MAGNITUDES[0], size / unequal))
        taken.add(law)


def judge(seed: int, stages: Sequence[str]) -> dict[str, Any]:
    """Fit and diagnose one campaign; return the truth and what was said."""
    start = time.process_time()
    case = campaign(seed)
    row: dict[str, Any] = {'seed': seed, 'kind': kind_of(seed), 'truth': case.truth}
    row['rows'] = sum(len(recording) for recording in case.recordings)
    times = {'simulate': time.process_time() - start}
    for stage in stages:
        start = time.process_time()
        try:
            row |= STAGES[stage](case)
        except UserError as error:
            row['refused'] = f'{stage}: {error}'
        except Exception as error:  # noqa: BLE001 (what breaks is what is counted)
            row['crash'] = f'{stage}: {type(error).__name__}: {error}'
        times[stage] = time.process_time() - start
    return row | {'cpu_s': {stage: round(value, 2) for stage, value in times.items()}}


def _fitted(case: Case) -> dict[str, Any]:
    model = tc.fit(case.recordings)
    return {'fitted': sorted(model.sensors)}


def _diagnosed(case: Case) -> dict[str, Any]:
    content = tc.diagnose(case.recordings).to_dict()
    findings = [{key: f[key] for key in FINDING if key in f} for f in content['findings']]
    held_out = {
        sensor: {'held_out': _rms(state['held_out_rms']), 'floor': _rms(state['noise_floor'])}
        for sensor, state in content['sensors'].items()
    }
    said = {'verdict': content['verdict'], 'findings': findings, 'sensors': held_out}
    further = ('explanations', 'prediction')
    return said | {key: content[key] for key in further if key in content}


def _grown(case: Case) -> dict[str, Any]:
    """Return what the verb `auto` adds, and what that leaves on the parts it holds out."""
    clean, _ = check_quality(case.recordings)
    growth = grow(None, prepare(clean), Settings(EFFECTS))
    return {'auto': {one.sensor: one.to_dict() for one in growth.predictions}}


def _rms(values: Any) -> float:
    known = np.asarray(values, float)
    known = known[np.isfinite(known)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float('nan')


def _true_form(case: Case) -> dict[str, Any]:
    """Return per sensor what the true form leaves on the parts a diagnosis holds out.

    Fitted by plain least squares to the other parts: a level per run, a line in the temperature
    and an amplitude per axis of every hidden effect. Rms of block means over the axes [SI].
    """
    if case.truth['simulator'] == 'own':
        return {}
    runs = prepare(case.recordings)
    if len(runs) != len(case.recordings):
        return {}
    part = np.concatenate([run.cv_group for run in runs])
    number = np.concatenate([np.full(len(run), k) for k, run in enumerate(runs)])
    levels = (number[:, None] == np.arange(len(runs))).astype(float)
    line = np.concatenate([run.temperature for run in runs])[:, None] / 30.0
    left = {}
    for sensor in sorted(set.intersection(*(set(run.measured) for run in runs))):
        measured = np.concatenate([run.measured[sensor] for run in runs])
        columns = [
            np.concatenate([
                run.block_mean(_at(run.conditions.time, recording.time, of_run[sensor]))
                for run, recording, of_run in zip(runs, case.recordings, effect, strict=True)
            ])
            for effect in case.hidden
            if sensor in effect[0]
        ]  # fmt: skip
        errors = [
            _held_out(measured[:, axis], part,
                      np.column_stack([levels, line, *(c[:, axis] for c in columns)]))
            for axis in range(3)
        ]  # fmt: skip
        left[sensor] = _rms(np.concatenate(errors))
    return {'true_form': left}


def _at(time: np.ndarray, rows: np.ndarray, signal: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(time, rows, axis) for axis in signal.T])


def _held_out(y: np.ndarray, part: np.ndarray, design: np.ndarray) -> np.ndarray:
    valid = np.isfinite(y)
    scaled = design / np.maximum(np.abs(design[valid]).max(0, initial=0.0), 1e-300)
    errors = [np.full(1, np.nan)]
    for one in np.unique(part[part > 0]):
        inside, rest = valid & (part == one), valid & (part != one)
        answer = np.linalg.lstsq(scaled[rest], y[rest], rcond=1e-9)[0]
        unseen = ~scaled[rest].any(axis=0)
        inside &= ~scaled[:, unseen].any(axis=1)
        errors.append(y[inside] - scaled[inside] @ answer)
    return np.concatenate(errors)


def _without_a_channel(case: Case) -> dict[str, Any]:
    """Return the answer without one of the channels that do not act; {} where none was logged."""
    needed = {track for effect in case.truth['effects'] for track in effect.get('needs', ())}
    spare = [
        track
        for track in SPARE
        if track not in needed
        and all(getattr(recording, track) is not None for recording in case.recordings)
    ]
    if not spare or case.truth['simulator'] == 'own':
        return {}
    dropped = spare[case.truth['seed'] % len(spare)]
    fewer = [replace(recording, **{dropped: None}) for recording in case.recordings]
    return {'without': {'track': dropped, **_diagnosed(replace(case, recordings=fewer))}}


STAGES: Mapping[str, Callable[[Case], dict[str, Any]]] = {
    'fit': _fitted,
    'diagnose': _diagnosed,
    'auto': _grown,
    'score': _true_form,
    'channels': _without_a_channel,
}


def results(
    seeds: Sequence[int], stages: Sequence[str], jobs: int, until: float
) -> Iterator[dict[str, Any]]:
    """Yield results as they come; start none after `until` [s of the monotonic clock]."""
    # One core per process; numpy reads this when the processes import it.
    os.environ |= {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}
    with ProcessPoolExecutor(jobs, mp_context=get_context('spawn')) as pool:
        queue = iter(seeds)
        running: set[Future[dict[str, Any]]] = {
            pool.submit(judge, seed, stages) for seed in islice(queue, jobs)
        }
        while running:
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                yield future.result()
                seed = next(queue, None) if time.monotonic() < until else None
                if seed is not None:
                    running.add(pool.submit(judge, seed, stages))


def _line(row: Mapping[str, Any]) -> str:
    hidden = ', '.join(
        f'{effect["name"]} {effect["magnitude"]:.2g}' for effect in row['truth']['effects']
    )
    said = row.get('crash') or row.get('refused') or row.get('verdict', '')
    names = ', '.join(f['name'] or f['kind'] for f in row.get('findings', ()))
    return f'{row["seed"]:>6} {row["kind"]:<20} {hidden or "nothing":<50} → {said}: {names}'


def _seeds(text: str) -> range:
    first, _, last = text.partition('..')
    return range(int(first), int(last or first) + 1)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog='Seeds from 900000 on are sealed.'
    )
    parser.add_argument('--quick', action='store_true', help='stop after a few minutes')
    parser.add_argument('--seeds', type=_seeds, default=range(150), metavar='A..B')
    parser.add_argument(
        '--kinds', nargs='+', choices=KINDS, default=KINDS, metavar='KIND', help=', '.join(KINDS)
    )
    parser.add_argument('--jobs', type=int, default=os.cpu_count())
    parser.add_argument('--seconds', type=float, default=1e9, help='start none after this time')
    parser.add_argument(
        '--channels',
        action='store_true',
        help='diagnose again without a channel that does not act',
    )
    parser.add_argument('--sealed', action='store_true', help=f'allow seeds from {SEALED} on')
    parser.add_argument('-o', '--output', type=Path, help='results, one JSON line each')
    parser.add_argument(
        '--tables', type=Path, nargs='+', metavar='FILE', help='only print the tables of FILEs'
    )
    options = parser.parse_args()
    if options.tables:
        for file in options.tables:
            print(f'{file}\n{tables(read(file))}\n')
        return
    if options.seeds[-1] >= SEALED and not options.sealed:
        parser.error(f'seeds from {SEALED} on are sealed; --sealed opens them, once')
    start = time.monotonic()
    usual = FOLDER / ('everyday_quick.jsonl' if options.quick else 'everyday.jsonl')
    output = options.output or usual
    output.parent.mkdir(parents=True, exist_ok=True)
    rows = read(output)
    done = {row['seed'] for row in rows}
    seeds = [seed for seed in options.seeds if kind_of(seed) in options.kinds]
    todo = [seed for seed in seeds if seed not in done]
    until = start + (QUICK_S if options.quick else options.seconds)
    stages = [stage for stage in STAGES if options.channels or stage != 'channels']
    precompile()
    with output.open('a', encoding='utf-8') as file:
        for row in results(todo, stages, options.jobs, until):
            rows.append(row)
            file.write(json.dumps(row) + '\n')
            file.flush()
            print(_line(row), flush=True)
    wanted = [row for row in rows if row['seed'] in seeds]
    left = len(seeds) - len(wanted)
    if left:
        print(f'\n{left} campaigns are left; the same command goes on with them')
    print(f'\n{tables(wanted)}\n\n{len(wanted)} campaigns, {time.monotonic() - start:.0f} s')


def read(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a file; a last line that was cut short is removed from it."""
    if not path.exists():
        return []
    whole, end, cut = path.read_text('utf-8').rpartition('\n')
    if cut:
        path.write_text(whole + end, 'utf-8')
    return [json.loads(line) for line in whole.splitlines()]


if __name__ == '__main__':
    main()
