# SPDX-License-Identifier: Apache-2.0
"""Attitude under temperature, bad starts, gaps, magnets: python benchmarks/filters_stress.py.

Every situation (stress_situations.py) is written from the physics (stress_motion.py: attitudes and
paths as closed formulas, sensors with noise, bias, jitter and losses). Both filters, preset
robust, beside VQF in the same run: rms of the angle between estimate and truth over the rows that
count, mean over the seeds; of the covariance the normalised squared error per degree of freedom (1
where it is true) and the share of rows within the 95 % bound. --seeds and --first-seed choose the
seeds. --drawn: every seed has a device, a place and a pace of its own (noises, field and
frequencies of the motion drawn from wide ranges), on which nothing was tuned; an error may then be
as large as VQF's where that is above the table's. Exit code 1 where a claim fails.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from imu_recording.recording import FloatArray
from orientation_filters.errors import attitude_errors, normalised_errors
from orientation_filters.filters import FILTERS, run_filter
from orientation_filters.rotation.arrays import conjugate, heading_angle, multiply, normalised
from stress_motion import DRAWN, RATE_HZ
from stress_situations import SITUATIONS, Run, Situation
from verdict import Verdict, judge
from vqf import VQF

NEES = (0.5, 2.0)
COVERAGE = (0.90, 0.99)
CHI2_95 = 7.815
"""95 % of chi-square with three degrees of freedom."""


def run_vqf(run: Run) -> FloatArray:
    """Return VQF's attitude; a rate of NaN is held, as VQF has no way to say that it is absent."""
    r = run.recording
    rate = r.angular_velocity.copy()
    good = np.isfinite(rate).all(axis=1)
    newest = np.maximum.accumulate(np.where(good, np.arange(len(rate)), 0))
    vqf = VQF(1.0 / RATE_HZ, **run.peer)
    if np.isnan(r.magnetic_field).all():
        out = vqf.updateBatch(rate[newest], r.linear_acceleration)['quat6D']
    else:
        field = r.magnetic_field.copy()
        known = np.isfinite(field).all(axis=1)
        held = np.maximum.accumulate(np.where(known, np.arange(len(field)), 0))
        out = vqf.updateBatch(rate[newest], r.linear_acceleration, 1e6 * field[held])['quat9D']
    q: FloatArray = out[:, [1, 2, 3, 0]]
    return q


def aligned(q: FloatArray, truth: FloatArray) -> tuple[FloatArray, float]:
    """Return attitudes turned about the vertical to a true first heading, and the angle [rad]."""
    apart = multiply(truth[0], conjugate(q[0]))
    turn = normalised(apart * [0.0, 0.0, 1.0, 1.0])
    return multiply(turn, q), float(heading_angle(turn))


def judge_run(run: Run, label: str) -> list[float]:
    """Return rms error [deg], normalised squared error per degree and share within 95 %.

    With six axes the heading at the start is arbitrary: it is no part of the rms, but the
    covariance has to cover it.
    """
    covariance, turned = None, 0.0
    if label == 'vqf':
        q = run_vqf(run)
    else:
        result = run_filter(label, run.recording, preset='robust', **run.options)
        q, covariance = result.orientation, result.covariance
    six_axes = not run.options.get('use_magnetometer', True)
    if six_axes:
        q, turned = aligned(q, run.truth)
    rms = np.degrees(attitude_errors(q, run.truth).rms(_mask(run))['total'])
    if covariance is None:
        return [float(rms), np.nan, np.nan]
    squares = normalised_errors(q, run.truth, covariance) + turned**2 / covariance[:, 2, 2]
    squares = squares[run.rows]
    squares = squares[np.isfinite(squares)]
    return [float(rms), float(np.mean(squares)) / 3.0, float(np.mean(squares < CHI2_95))]


def _mask(run: Run) -> FloatArray:
    mask = np.zeros(len(run.truth), dtype=bool)
    mask[run.rows] = True
    return mask


def table(situations: tuple[Situation, ...], seeds: range) -> dict[str, dict[str, FloatArray]]:
    """Return (seeds, 3) figures by situation and filter."""
    found = {}
    for situation in situations:
        runs = [situation.make(seed) for seed in seeds]
        found[situation.name] = {
            label: np.array([judge_run(run, label) for run in runs]) for label in (*FILTERS, 'vqf')
        }
        report(situation, found[situation.name])
    return found


def report(situation: Situation, figures: dict[str, FloatArray]) -> None:
    """Print one row of the table."""
    cells = f'{situation.name:40}'
    for label, rows in figures.items():
        rms, nees, coverage = rows.mean(axis=0)
        cells += f'  {label[:4]} {rms:7.2f}° (worst {rows[:, 0].max():6.2f})'
        if label != 'vqf':
            cells += f' NEES {nees:6.2f} in {100 * coverage:4.0f} %'
    print(cells, flush=True)


def claims(
    situations: tuple[Situation, ...], found: dict[str, dict[str, FloatArray]], *, drawn: bool
) -> list[Verdict]:
    """Return the claims about every situation and filter."""
    verdicts = []
    for situation in situations:
        peer = float(found[situation.name]['vqf'][:, 0].mean()) if drawn else 0.0
        limit = max(situation.limit, peer)
        for label in FILTERS:
            rows = found[situation.name][label]
            claim = f'{label}, {situation.name}'
            rms, nees, coverage = rows.mean(axis=0)
            verdicts.append(Verdict(f'{claim}: rms', rms, limit, '°'))
            if np.isfinite(situation.worst) and not drawn:
                worst = rows[:, 0].max()
                verdicts.append(Verdict(f'{claim}: worst', worst, situation.worst, '°'))
            verdicts += [
                Verdict(f'{claim}: NEES', nees, NEES[1]),
                Verdict(f'{claim}: NEES', nees, NEES[0], at_least=True),
                Verdict(f'{claim}: within 95 %', coverage, COVERAGE[0], at_least=True),
                Verdict(f'{claim}: within 95 %', coverage, COVERAGE[1]),
            ]
    return verdicts


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=20)
    parser.add_argument('--first-seed', type=int, default=0)
    parser.add_argument('--drawn', action='store_true', help='devices and places by seed')
    parser.add_argument('--only', default='', help='part of the situation names to run')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    first = options.first_seed + (DRAWN if options.drawn else 0)
    seeds = range(first, first + options.seeds)
    situations = tuple(s for s in SITUATIONS if options.only in s.name)
    found = table(situations, seeds)
    failed = judge(claims(situations, found, drawn=options.drawn))
    if options.json:
        rows = {
            name: {label: figures.tolist() for label, figures in by_filter.items()}
            for name, by_filter in found.items()
        }
        content = {'seeds': list(seeds), 'rows': rows, 'failed': failed}
        options.json.write_text(json.dumps(content, indent=1) + '\n')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
