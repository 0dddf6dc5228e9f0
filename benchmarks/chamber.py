# SPDX-License-Identifier: Apache-2.0
"""How good the chamber side is: the paper's run, kills at random moments, random trouble.

    python benchmarks/chamber.py [--quick] [--kills 20]

Numbers are medians of this machine; ramps and dwells are measured on what was written to the
chamber and on the journal.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from chamber_profile.chambers.simulated import SimulatedChamber
from chamber_profile.profile.file import load_profile
from chamber_profile.profile.unroll import campaign_steps
from chamber_profile.run.chamber_link import carry_out, readings_of
from chamber_profile.run.sequencer import Sequencer
from chamber_profile.run.simulation import simulate_chamber
from chamber_profile.run.values import DWELL, FINISHED

PAPER = load_profile('paper_betta2022')
KILLS_A_RUN = 3


def paper_run() -> dict[str, list[tuple]]:
    """Drive the simulated chamber through the paper's run at 1 s; return times and events."""
    chamber = SimulatedChamber(seed=1)
    sequencer = Sequencer(PAPER, chamber.resolution_c)
    sequencer.command('start')
    rows, notes, second = [], [], 0
    while sequencer.progress.mode not in FINISHED:
        chamber.advance(1.0)
        actions = sequencer.tick(readings_of(float(second), chamber.read()))
        carry_out(actions, chamber, lambda note, at=second: notes.append((at, note)))
        rows.append((second, chamber.setpoint, sequencer.progress.setpoint, sequencer.step))
        second += 1
    return {'rows': rows, 'notes': notes}


def set_point_error(run: dict) -> float:
    """Largest distance of the written set-point from the ideal ramp [K]."""
    worst = 0.0
    for step_id in ('cool', 'heat', 'return'):
        rows = [row for row in run['rows'] if row[3].id == step_id and row[3].cycle == 1]
        time_s = np.array([row[0] for row in rows], float)
        written = np.array([row[1] for row in rows])
        target, rate = rows[0][3].target_c, rows[0][3].rate_c_per_min
        start = {'cool': 20.0, 'heat': -10.0, 'return': 50.0}[step_id]
        way = np.sign(target - start) * rate / 60.0 * (time_s - time_s[0])
        ideal = np.clip(start + way, min(start, target), max(start, target))
        worst = max(worst, float(np.abs(written - ideal).max()))
    return worst


def dwell_errors(run: dict) -> list[float]:
    """Relative error of every dwell's length."""
    errors, began = [], None
    for at, note in run['notes']:
        step = campaign_steps(PAPER)[note.progress.step]
        if note.event == 'stage' and note.progress.stage == DWELL:
            began = (at, step)
        elif began is not None:
            errors.append((at - began[0]) / began[1].dwell_s - 1.0)
            began = None
    return errors


def ramp_errors(run: dict) -> list[float]:
    """Relative error of every ramp's mean rate between 10 % and 90 % of its span."""
    errors = []
    rows = run['rows']
    starts = [i for i in range(1, len(rows)) if rows[i][3] is not rows[i - 1][3]]
    for first, last in zip(starts, [*starts[1:], len(rows)], strict=True):
        step = rows[first][3]
        if step.kind != 'ramp':
            continue
        part = rows[first:last]
        written = np.array([row[1] for row in part])
        time_s = np.array([row[0] for row in part], float)
        low, high = sorted((written[0], step.target_c))
        span = high - low
        inner = (written > low + 0.1 * span) & (written < high - 0.1 * span)
        rate = abs(np.polyfit(time_s[inner], written[inner], 1)[0]) * 60.0
        errors.append(rate / step.rate_c_per_min - 1.0)
    return errors


def kills(count: int) -> tuple[int, int]:
    """Kill real processes at random moments; return kills and runs, all of which completed."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test' / 'chamber_profile'))
    from laboratory import Laboratory, assert_complete

    moments = np.random.default_rng(2022)
    done = completed = 0
    while done < count:
        with tempfile.TemporaryDirectory() as folder:
            laboratory = Laboratory(Path(folder))
            try:
                for kill in range(min(KILLS_A_RUN, count - done)):
                    node = laboratory.node()
                    laboratory.until(node, 'interrupted' if kill else 'run: RUN')
                    time.sleep(moments.uniform(0.0, 2.0))
                    node.kill()
                    laboratory.finish(node)
                    done += 1
                    if laboratory.journal()[-1].get('mode') == 'DONE':
                        break
                laboratory.finish(laboratory.node())
                assert_complete(laboratory.journal())
                completed += 1
            finally:
                laboratory.close()
    return done, completed


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--quick', action='store_true', help='without the kills')
    parser.add_argument('--kills', type=int, default=20)
    options = parser.parse_args()
    simulate_chamber(PAPER, seed=0)
    times = []
    for seed in range(5):
        began = time.process_time()
        simulate_chamber(PAPER, seed=seed)
        times.append(time.process_time() - began)
    print(f'simulate_chamber, 12 h at 1 s: {statistics.median(times):.2f} s of CPU (median of 5)')
    began = time.perf_counter()
    run = paper_run()
    print(f"the paper's run in-process, a tick a second: {time.perf_counter() - began:.1f} s")
    print(f'set-point from the ideal ramp: at most {set_point_error(run):.3f} K (bound 0.134 K)')
    dwells, ramps = dwell_errors(run), ramp_errors(run)
    print(f'{len(dwells)} dwells: length within {max(map(abs, dwells)):.2%}')
    print(f'{len(ramps)} ramps: rate within {max(map(abs, ramps)):.2%}')
    if not options.quick:
        done, completed = kills(options.kills)
        print(f'{done} kills at random moments: all {completed} runs completed, '
              'every dwell whole, every set-point within the limits')  # fmt: skip
    return 0


if __name__ == '__main__':
    sys.exit(main())
