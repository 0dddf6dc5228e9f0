# SPDX-License-Identifier: Apache-2.0
"""Real recordings: the error that is left on parts no model was fitted to, ours beside the peers'.

Judged is the rms of 20 s means (shorter in a recording of minutes) of measured minus predicted
about the level of the fit, per axis.
Recordings are read from ../shared/data (--data) or given with --recording; nothing is fetched.
Peers (requirements-bench.txt) see temperature, its rate and three lagged temperatures; a line is
taken out before the Gaussian process and the boosted trees, so that they extrapolate with it.
"""

from __future__ import annotations

import os

# One thread for everybody: boosted trees share small tables among threads, which costs them more.
os.environ.setdefault('OMP_NUM_THREADS', '1')
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_UNITS, FloatArray
from thermal_comp.model.values import ThermalModel
from thermal_real_cases import (
    LAGS_S,
    MEAN_S,
    ROOT,
    Case,
    Fold,
    Mask,
    features,
    fold_of,
    given_case,
    public_cases,
    scale_of,
    values_of,
    within_range,
)
from thermal_real_methods import OURS, PEERS, Predictor, numbers_stored, training_recording

import thermal_comp as tc
from imu_recording import ImuRecording

CLEAR = 1.05
"""A ratio of held-out errors above this is a difference worth a word."""
BLACK_BOXES = ('Gaussian process', 'gradient boosting', 'SINDy')
SHOWN = {'rad/s': ('m°/s', 1e3 * 180 / np.pi), 'm/s²': ('mg', 1e3 / 9.80665), 'T': ('µT', 1e6)}
"""Unit and factor of the printed errors."""


def residual_of_model(fold: Fold, model: ThermalModel, sensor: str) -> FloatArray:
    """Return the (m, 3) block means of the compensated values."""
    compensated = tc.compensate(replace(fold.recording, temperature_stamp=None), model)
    return fold.means(values_of(compensated, sensor))


@dataclass(frozen=True, eq=False)
class Result:
    """What a method leaves on the held-out blocks of a case."""

    method: str
    residual: dict[str, FloatArray]
    """Sensor → (m, 3) held-out residuals about the level of the fit [unit]."""
    seconds: float
    numbers: float
    """Stored for one axis, mean over axes and folds."""
    terms: dict[str, list[str]]
    """Sensor → effects of the last fold's model; empty for peers."""

    def rms(self, sensor: str, rows: Mask | slice = slice(None)) -> FloatArray:
        """(3,) over all held-out blocks or some [unit]."""
        rms: FloatArray = np.sqrt(np.nanmean(self.residual[sensor][rows] ** 2, axis=0))
        return rms


def run_case(case: Case) -> list[Result]:
    """Return the result of every method on one case."""
    folds = [fold_of(case.recording, part) for part in case.held_out]
    known = [features(fold) for fold in folds]
    results = [_peer(name, fit, case, folds, known) for name, fit in PEERS.items()]
    return results + [_ours(name, fit, case, folds) for name, fit in OURS.items()]


def _peer(
    name: str, fit: Predictor, case: Case, folds: Sequence[Fold], known: Sequence[FloatArray]
) -> Result:
    started = time.perf_counter()
    residual: dict[str, list[FloatArray]] = {s: [] for s in case.sensors()}
    sizes = []
    for fold, inputs in zip(folds, known, strict=True):
        for sensor, parts in residual.items():
            means = fold.means(values_of(fold.recording, sensor))
            left = np.empty_like(means)
            for axis in range(3):
                seen = fold.seen & np.isfinite(means[:, axis])
                predicted, size = fit(inputs[seen], means[seen, axis], inputs)
                left[:, axis] = means[:, axis] - predicted
                sizes.append(size)
            parts.append((left - np.nanmean(left[fold.seen], axis=0))[~fold.seen])
    seconds = time.perf_counter() - started
    joined = {s: np.concatenate(parts) for s, parts in residual.items()}
    return Result(name, joined, seconds, float(np.mean(sizes)), {})


def _ours(
    name: str,
    fit: Callable[[ImuRecording], ThermalModel],
    case: Case,
    folds: Sequence[Fold],
) -> Result:
    started = time.perf_counter()
    residual: dict[str, list[FloatArray]] = {s: [] for s in case.sensors()}
    sizes = []
    terms: dict[str, list[str]] = {}
    for fold in folds:
        model = fit(training_recording(fold))
        for sensor, parts in residual.items():
            left = residual_of_model(fold, model, sensor)
            parts.append((left - np.nanmean(left[fold.seen], axis=0))[~fold.seen])
            sizes.append(numbers_stored(model, sensor))
            terms[sensor] = [effect.name for effect in model.sensors[sensor].effects]
    seconds = time.perf_counter() - started
    joined = {s: np.concatenate(parts) for s, parts in residual.items()}
    return Result(name, joined, seconds, float(np.mean(sizes)), terms)


def remaining_dependence(case: Case, residual: FloatArray) -> tuple[str, float]:
    """Return the variable that explains most of a residual (m,) by a parabola, and its share."""
    folds = [fold_of(case.recording, part) for part in case.held_out]
    inputs = np.concatenate([features(fold)[~fold.seen] for fold in folds])
    seconds = np.concatenate([fold.means(fold.recording.time)[~fold.seen] for fold in folds])
    lags = scale_of(case.recording) * np.array(LAGS_S)
    names = ('temperature', 'rate', *(f'lag of {lag:.3g} s' for lag in lags), 'time')
    known = np.isfinite(residual)
    wanted = residual[known] - residual[known].mean()
    shares = {}
    for name, values in zip(names, [*inputs.T, seconds], strict=True):
        fitted = np.polynomial.Polynomial.fit(values[known], wanted, 2)(values[known])
        shares[name] = 1.0 - float(np.sum((wanted - fitted) ** 2) / np.sum(wanted**2))
    best = max(shares, key=lambda name: shares[name])
    return best, shares[best]


def report(case: Case, results: Sequence[Result]) -> list[dict[str, Any]]:
    """Print the table of a case, and where a black box is better; return plain values."""
    sensors = case.sensors()
    units = {s: SHOWN[SENSOR_UNITS[s]] for s in sensors}
    heads = [f'{s[:3]} {axis} {units[s][0]}' for s in sensors for axis in 'xyz']
    width = max(len(head) for head in heads) + 2
    inside = within_range(case)
    mean_s = scale_of(case.recording) * MEAN_S
    print(f'\n{case.name}: held-out rms of {mean_s:.3g} s means, {len(case.held_out)} fits')
    print(
        f'{"":24}' + ''.join(f'{h:>{width}}' for h in heads) + f'{"numbers":>9}{"s":>8}{"× GP":>7}'
    )
    pace = next(r.seconds for r in results if r.method == 'Gaussian process')
    rows = []
    for result in results:
        shown = {s: result.rms(s) * units[s][1] for s in sensors}
        tail = f'{result.numbers:>9.0f}{result.seconds:>8.2f}{result.seconds / pace:>7.2f}'
        print(f'{result.method:24}{_cells(shown, width)}{tail}')
        rows.append(
            {
                'case': case.name,
                'method': result.method,
                'held_out_rms': {s: shown[s].tolist() for s in sensors},
                'unit': {s: units[s][0] for s in sensors},
                'numbers': result.numbers,
                'seconds': result.seconds,
                'terms': result.terms,
            }
        )
    if inside.any() and not inside.all():
        print(f'of these, the {inside.mean():.0%} at temperatures the fit has seen:')
        for result, row in zip(results, rows, strict=True):
            shown = {s: result.rms(s, inside) * units[s][1] for s in sensors}
            print(f'{result.method:24}{_cells(shown, width)}')
            row['held_out_rms_within_range'] = {s: shown[s].tolist() for s in sensors}
    for result in results:
        for sensor, names in result.terms.items():
            print(f'  {result.method}, {sensor}: {", ".join(names)}')
    for line in better_black_boxes(case, results):
        print(f'  {line}')
    return rows


def _cells(shown: dict[str, FloatArray], width: int) -> str:
    return ''.join(f'{value:>{width}.3g}' for values in shown.values() for value in values)


def better_black_boxes(case: Case, results: Sequence[Result]) -> list[str]:
    """Return a line per axis where a black box is clearly better than ours, and on what."""
    ours = next(r for r in results if r.method == 'ours, predictive')
    lines = []
    for sensor in case.sensors():
        boxes = {r.method: r.rms(sensor) for r in results if r.method in BLACK_BOXES}
        for axis in range(3):
            best = min(boxes, key=lambda name: boxes[name][axis])
            ratio = float(ours.rms(sensor)[axis] / boxes[best][axis])
            if ratio > CLEAR:
                variable, share = remaining_dependence(case, ours.residual[sensor][:, axis])
                lines.append(
                    f'{sensor} {"xyz"[axis]}: {best} leaves 1/{ratio:.2f} of ours; {variable} '
                    f'explains {share:.0%} of what ours leaves'
                )
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--data', type=Path, default=ROOT.parent / 'shared' / 'data')
    parser.add_argument('--only', default='', help='cases whose name holds this')
    parser.add_argument('--recording', type=Path, help='a bag, or a CSV file with --mapping')
    parser.add_argument('--mapping', type=Path, help='what the columns of a CSV file are')
    parser.add_argument('--train', help='rows the fit sees, a..b; default: five blocks in turn')
    parser.add_argument('--json', type=Path, help='also write every number')
    options = parser.parse_args()
    if options.recording:
        cases = [given_case(options.recording, options.mapping, options.train)]
    else:
        cases = [case for case in public_cases(options.data) if options.only in case.name]
    if not cases:
        sys.stderr.write(f'no recording in {options.data}: give one with --recording\n')
        return 2
    warnings.filterwarnings('ignore', module='sklearn|pysindy')
    rows = [row for case in cases for row in report(case, run_case(case))]
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
