# SPDX-License-Identifier: Apache-2.0
"""Real recordings: the error that is left on parts no model was fitted to, ours beside the peers'.

Judged is the rms of 20 s means of measured minus predicted about the level of the fit, per axis.
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
import contextlib
import io
import json
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, SENSOR_UNITS, FloatArray
from imu_recording.tables.csv_import import import_csv
from imu_workbench.__main__ import main as workbench
from numpy.typing import NDArray
from pysindy.feature_library import PolynomialLibrary
from pysindy.optimizers import STLSQ
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from thermal_comp.effects.operators import follow
from thermal_comp.model.values import ModelError, ThermalModel

import thermal_comp as tc
from imu_recording import ImuRecording, read_bag, write_bag

ROOT = Path(__file__).resolve().parents[1]
MEAN_S = 20.0
"""What is judged are means over this time [s]."""
RATE_S = 30.0
"""Time constant of the rate that peers see [s]."""
LAGS_S = (60.0, 300.0, 1200.0)
"""Time constants of the lagged temperatures that peers see [s]."""
BLOCKS = 5
"""Parts of a recording that are held out in turn where no split is given."""
GP_ROWS = 700
"""Most rows a Gaussian process is fitted to: its time grows with their cube."""
THRESHOLDS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Coefficients of standardised features that SINDy may leave out below; by cross-validation."""
MOST_STEPS = 6
"""Effects added by name before it stops, as `auto` does."""
HAND_MADE = ('bias_temperature', 'bias_temperature_curvature', 'thermal_lag_two_stage')
CLEAR = 1.05
"""A ratio of held-out errors above this is a difference worth a word."""
BLACK_BOXES = ('Gaussian process', 'gradient boosting', 'SINDy')
SHOWN = {'rad/s': ('m°/s', 1e3 * 180 / np.pi), 'm/s²': ('mg', 1e3 / 9.80665), 'T': ('µT', 1e6)}
"""Unit and factor of the printed errors."""

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Case:
    """A recording and the parts of it that are held out, each by a fit to the rest."""

    name: str
    recording: ImuRecording
    held_out: tuple[slice, ...]

    def sensors(self) -> list[str]:
        """Return the sensors with at least one measured value."""
        return [s for s in SENSOR_FIELDS if np.isfinite(values_of(self.recording, s)).any()]


@dataclass(frozen=True, eq=False)
class Fold:
    """One fit: what it sees and what it is judged on."""

    recording: ImuRecording
    train: Mask
    blocks: NDArray[np.int64]
    """(m, 2) first row of each block of MEAN_S and the first one after it."""
    seen: Mask
    """(m,) blocks the fit sees; the others are judged."""

    def means(self, values: FloatArray) -> FloatArray:
        """Return the (m, …) block means of (n, …) rows."""
        with warnings.catch_warnings():
            warnings.simplefilter('ignore', RuntimeWarning)  # a block without any value is NaN
            return np.array([np.nanmean(values[a:b], axis=0) for a, b in self.blocks])


def values_of(recording: ImuRecording, sensor: str) -> FloatArray:
    """Return the (n, 3) measured values of a sensor."""
    values: FloatArray = getattr(recording, SENSOR_FIELDS[sensor])
    return values


def fold_of(recording: ImuRecording, held_out: slice) -> Fold:
    """Return the fit to all rows but the held-out ones; no block reaches over a border."""
    n = len(recording)
    train = np.ones(n, dtype=bool)
    train[held_out] = False
    rows = max(round(MEAN_S / (float(recording.time[-1]) / (n - 1))), 1)
    borders = [0, *(np.flatnonzero(np.diff(train.astype(int))) + 1).tolist(), n]
    starts = [k for a, b in pairwise(borders) for k in range(a, b - rows + 1, rows)]
    blocks = np.array([(k, k + rows) for k in starts], dtype=np.int64)
    return Fold(recording, train, blocks, train[blocks[:, 0]])


def features(fold: Fold) -> FloatArray:
    """Return (m, 5) block means of temperature, rate and lagged minus present temperatures."""
    seconds, temperature = fold.recording.time, fold.recording.temperature
    held = np.interp(np.arange(len(temperature)), *_finite(temperature))
    lagged = [follow(seconds, held, lag)[0] - held for lag in (RATE_S, *LAGS_S)]
    return fold.means(np.column_stack([held, -lagged[0] / RATE_S, *lagged[1:]]))


def _finite(values: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    known = np.flatnonzero(np.isfinite(values))
    return known, values[known]


Predictor = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, int]]
"""(features seen, error of one axis seen, all features) → prediction of all blocks, numbers."""


def linear(design: Callable[[FloatArray], FloatArray]) -> Predictor:
    """Return the least-squares fit of a design and a level."""

    def predict(seen: FloatArray, error: FloatArray, every: FloatArray) -> tuple[FloatArray, int]:
        columns = np.column_stack([np.ones(len(seen)), design(seen)])
        found = np.linalg.lstsq(columns, error, rcond=None)[0]
        return np.column_stack([np.ones(len(every)), design(every)]) @ found, len(found)

    return predict


def _cubic(features: FloatArray) -> FloatArray:
    scaled = features[:, 0] / 50.0
    return np.column_stack([scaled, scaled**2, scaled**3])


LINE = linear(lambda features: features[:, :1])


def standardised(seen: FloatArray, every: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both with mean 0 and deviation 1 over what the fit sees."""
    mean, spread = seen.mean(axis=0), np.maximum(seen.std(axis=0), 1e-9)
    return (seen - mean) / spread, (every - mean) / spread


def beside_line(fit: Callable[[FloatArray, FloatArray], Any], size: Callable[[Any], int]) -> Any:
    """Return the predictor that fits what a line leaves with a scikit-learn regressor."""

    def predict(seen: FloatArray, error: FloatArray, every: FloatArray) -> tuple[FloatArray, int]:
        line = LINE(seen, error, seen)[0]
        scale = float((error - line).std()) or 1.0
        inside, outside = standardised(seen, every)
        fitted = fit(inside, (error - line) / scale)
        return LINE(seen, error, every)[0] + scale * fitted.predict(outside), 2 + size(fitted)

    return predict


def _gaussian_process(inside: FloatArray, error: FloatArray) -> GaussianProcessRegressor:
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF(
        np.ones(inside.shape[1]), (1e-1, 1e3)
    ) + WhiteKernel(0.1, (1e-6, 1e2))
    thinned = slice(None, None, -(-len(inside) // GP_ROWS))
    return GaussianProcessRegressor(kernel).fit(inside[thinned], error[thinned])


def _boosted(inside: FloatArray, error: FloatArray) -> HistGradientBoostingRegressor:
    return HistGradientBoostingRegressor(random_state=1).fit(inside, error)


def sindy(seen: FloatArray, error: FloatArray, every: FloatArray) -> tuple[FloatArray, int]:
    """Return the sparse polynomial of degree 3 in all features (Brunton et al. 2016).

    The threshold is that with the least error over five contiguous parts of what is seen.
    """
    inside, outside = standardised(seen, every)
    library = PolynomialLibrary(degree=3).fit(inside)
    columns = np.asarray(library.transform(inside))
    mean, scale = float(error.mean()), float(error.std()) or 1.0
    wanted = (error - mean) / scale
    parts = np.arange(len(wanted)) * BLOCKS // len(wanted)

    def sparse(rows: Mask, threshold: float) -> FloatArray:
        found = STLSQ(threshold=threshold, alpha=0.05).fit(columns[rows], wanted[rows, None])
        coefficients: FloatArray = found.coef_[0]
        return coefficients

    def missed(threshold: float) -> float:
        return sum(
            float(np.sum((wanted[held] - columns[held] @ sparse(~held, threshold)) ** 2))
            for held in (parts == k for k in range(BLOCKS))
        )

    chosen = sparse(parts >= 0, min(THRESHOLDS, key=missed))
    predicted = mean + scale * (np.asarray(library.transform(outside)) @ chosen)
    return predicted, 1 + int(np.count_nonzero(chosen))


PEERS: dict[str, Predictor] = {
    'raw': lambda _, error, every: (np.full(len(every), error.mean()), 0),
    'line': LINE,
    'cubic (PX4, ArduPilot)': linear(_cubic),
    'cubic + rate': linear(lambda f: np.column_stack([_cubic(f), 60.0 * f[:, 1]])),
    'Gaussian process': beside_line(
        _gaussian_process, lambda fitted: fitted.X_train_.size * 6 // 5
    ),
    'gradient boosting': beside_line(
        _boosted, lambda fitted: 2 * sum(len(t[0].nodes) for t in fitted._predictors)
    ),
    'SINDy': sindy,
}


def training_recording(fold: Fold) -> ImuRecording:
    """Return what a fit may see: rows around a held-out part keep their temperature alone."""
    kept = np.flatnonzero(fold.train)
    first, last = int(kept[0]), int(kept[-1]) + 1
    part = fold.recording.rows(slice(first, last))
    hidden = ~fold.train[first:last]
    if not hidden.any():
        return part
    blank: dict[str, Any] = {
        field: np.where(hidden[:, None], np.nan, getattr(part, field))
        for field in SENSOR_FIELDS.values()
    }
    return replace(part, **blank)


def fit_named(recording: ImuRecording) -> ThermalModel:
    """Return the model with every effect that a diagnosis names, one after the other."""
    model = None
    for _ in range(MOST_STEPS):
        found = tc.diagnose([recording], model)
        try:
            model = tc.add([recording], found, model).model
        except ModelError:  # it names nothing that could be added
            break
    return model or tc.fit([recording])


def fit_predictive(recording: ImuRecording) -> ThermalModel:
    """Return the model that the verb `auto` ends with."""
    with tempfile.TemporaryDirectory() as folder:
        bag, target = Path(folder, 'bag'), Path(folder, 'model.yaml')
        write_bag(recording, bag)
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = workbench(['auto', str(bag), '-o', str(target)])
        if code:
            raise RuntimeError(f'auto ended with exit code {code}: {said.getvalue()[-500:]}')
        return tc.load(target)


def fit_by_hand(recording: ImuRecording) -> ThermalModel:
    """Return the model that a person would try first: curvature and a two-stage lag."""
    return tc.fit([recording], HAND_MADE)


OURS = {
    'ours, by hand': fit_by_hand,
    'ours, named': fit_named,
    'ours, predictive': fit_predictive,
}


def numbers_stored(model: ThermalModel, sensor: str) -> int:
    """Return how many numbers predict one axis: coefficients, shape parameters, the level."""
    known = model.sensors[sensor]
    shapes = sum(
        int(np.size(getattr(effect, item.name)))
        for effect in known.effects
        for item in fields(effect)
    )
    return 1 + shapes + sum(len(coefficients) for coefficients in known.coefficients)


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


def within_range(case: Case) -> Mask:
    """Return the held-out blocks whose mean temperature the fit has seen."""
    parts = []
    for fold in (fold_of(case.recording, part) for part in case.held_out):
        temperature = fold.means(fold.recording.temperature)
        seen = temperature[fold.seen]
        held = temperature[~fold.seen]
        parts.append((held >= np.nanmin(seen)) & (held <= np.nanmax(seen)))
    return np.concatenate(parts)


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
    names = ('temperature', 'rate', *(f'lag of {lag:g} s' for lag in LAGS_S), 'time')
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
    print(f'\n{case.name}: held-out rms of {MEAN_S:g} s means, {len(case.held_out)} fits')
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


def in_blocks(name: str, recording: ImuRecording) -> Case:
    """Return the case that holds out contiguous parts of a recording in turn."""
    edges = np.linspace(0, len(recording), BLOCKS + 1).astype(int).tolist()
    parts = tuple(slice(a, b) for a, b in pairwise(edges))
    return Case(f'{name}, {BLOCKS} blocks in turn', recording, parts)


def public_cases(data: Path) -> list[Case]:
    """Return the cases of the public recordings that lie in a folder."""
    cases = []
    drone = data / 'tofupilot_chamber' / 'imu_raw_data.csv'
    if drone.is_file():
        read = import_csv(drone, ROOT / 'examples' / 'tofupilot_mapping.yaml')
        cold, hot = int(read.temperature.argmin()), int(read.temperature.argmax())
        cases += [
            Case('tofupilot, last cooling (rows 6800 …)', read, (slice(6800, len(read)),)),
            Case(f'tofupilot, first cooling (rows 0 … {cold})', read, (slice(0, cold),)),
            Case(f'tofupilot, heating (rows {cold} … {hot})', read, (slice(cold, hot),)),
            in_blocks('tofupilot', read),
        ]
    board = data / 'freeimu_freezer' / 'Tempdata01-02-14.csv'
    if board.is_file():
        read = import_csv(board, ROOT / 'examples' / 'freeimu_mapping.yaml')
        cases.append(in_blocks('freeimu', read))
    return cases


def given_case(path: Path, mapping: Path | None, train: str | None) -> Case:
    """Return the case of a bag or, with a mapping, of a CSV file."""
    recording = import_csv(path, mapping) if mapping else read_bag(path)
    if train is None:
        return in_blocks(path.stem, recording)
    first, separator, last = train.partition('..')
    if not separator or not (first + last).isdigit() or int(first) >= int(last):
        raise SystemExit(f'--train {train}: expected rows a..b with a below b, e.g. 0..6799')
    a, b, n = int(first), int(last) + 1, len(recording)
    if a > 0 and b < n:
        raise SystemExit(f'--train {train}: start at row 0 or end at row {n - 1}')
    return Case(
        f'{path.stem}, fitted to {train}', recording, (slice(b, n) if a == 0 else slice(a),)
    )


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
