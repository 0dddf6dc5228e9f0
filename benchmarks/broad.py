# SPDX-License-Identifier: Apache-2.0
"""Attitude error on real motion with optical truth: python benchmarks/broad.py [--data DIR].

DIR holds trials of BROAD (Laidig et al., Data 6(7):72, 2021) as MATLAB files, any number of them.
Every filter beside vqf, vqf offline, imufusion and ahrs; total, heading and inclination rms over
the movement phase, starting from the first sample, and total with the mean heading error of the
trial taken away. `robust` is judged twice: with its own parameters, the same for all trials, and
cross-validated, each trial with the values of all TUNED parameters that the others choose. Of the
covariance the normalised squared error per degree of freedom and the share of rows within 95 %.
With --freezer DIR (default: beside DIR) a real board's temperature errors are added to the motion,
and taken away again by a model fitted to other measurements of that board; the trials choose by
their error with and without them. Exit code 1 where a claim fails.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from cross_validation import CrossValidation
from imu_recording.recording import FloatArray
from imu_recording.tables.csv_import import import_csv
from orientation_filters.errors import ERROR_KINDS, attitude_errors, normalised_errors
from orientation_filters.filters import run_filter
from orientation_filters.result import OrientationResult
from orientation_filters.rotation.arrays import conjugate, multiply, normalised
from orientation_filters.smoothing import run_smoother
from scipy.io import loadmat
from thermal_comp.compensation.recording import compensate
from thermal_comp.effects import EFFECTS
from thermal_comp.fitting.fit import fit
from verdict import Verdict, judge
from vqf import VQF, offlineVQF

from imu_recording import ImuRecording

OURS = [(name, preset) for name in ('complementary', 'ahrs') for preset in ('paper', 'robust')]
COLUMNS = (*ERROR_KINDS, 'aligned')
LIMITS = {'ahrs robust': 0.95, 'complementary robust': 1.0}
"""Largest mean total error as a multiple of VQF's, cross-validated."""
ALIGNED_LIMIT = 1.0
NEES, COVERAGE, CHI2_95 = (0.5, 2.0), (0.90, 0.99), 7.815
TUNED = {
    'rate_error': 0.01,
    'bias_random_walk': 1e-4,
    'acceleration_weight': 0.01,
    'acceleration_memory': 1.0,
    'acceleration_smoothing': 1.0,
    'slow_weight': 0.1,
    'rest_noise': 1e-3,
    'initial_bias': 0.01,
    'field_weight': 1.0,
    'field_memory': 10.0,
    'field_tolerance': 0.1,
    'angle_random_walk': 2e-4,
}
"""Orders of magnitude at which cross-validation begins; an angle random walk as in data sheets."""
TUNED_BY_FILTER = {
    'ahrs': {'acceleration_floor': 0.01, 'heading_noise': 0.01},
    'complementary': {'cutoff_hz': 0.05, 'heading_cutoff_hz': 0.02},
}
SLOW_LIMIT_DEG = 3.0
THERMAL_LIMIT = 1.05
RAW_LIMIT = 1.25
BLOCK_S = 20.0
REFERENCE_C = 20.0
MAPPING = Path(__file__).resolve().parents[1] / 'examples' / 'freeimu_mapping.yaml'
DATA = Path(__file__).resolve().parents[2] / 'shared' / 'data' / 'broad'
MODEL = ('bias_temperature', 'bias_temperature_curvature')


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial: the recording with its truth, and the rows that count."""

    name: str
    recording: ImuRecording
    movement: np.ndarray
    rate_hz: float


def load_trial(path: Path) -> Trial:
    data = loadmat(path)
    rate_hz = float(data['sampling_rate'].ravel()[0]) if 'sampling_rate' in data else 2000 / 7
    n = len(data['imu_gyr'])
    recording = ImuRecording(
        stamp=np.round(np.arange(n) * (1e9 / rate_hz)).astype(np.int64),
        angular_velocity=np.ascontiguousarray(data['imu_gyr']),
        linear_acceleration=np.ascontiguousarray(data['imu_acc']),
        magnetic_field=np.ascontiguousarray(data['imu_mag']) * 1e-6,
        temperature=np.full(n, REFERENCE_C),
        reference_orientation=data['opt_quat'][:, [1, 2, 3, 0]],
        device='broad',
    )
    return Trial(path.stem, recording, data['movement'].ravel().astype(bool), rate_hz)


def run_vqf(trial: Trial) -> FloatArray:
    r = trial.recording
    result = VQF(1 / trial.rate_hz).updateBatch(
        r.angular_velocity, r.linear_acceleration, r.magnetic_field * 1e6
    )
    q: FloatArray = result['quat9D'][:, [1, 2, 3, 0]]
    return q


def run_offline_vqf(trial: Trial) -> FloatArray:
    r = trial.recording
    columns = r.angular_velocity, r.linear_acceleration, r.magnetic_field * 1e6
    q: FloatArray = offlineVQF(*columns, 1 / trial.rate_hz)['quat9D'][:, [1, 2, 3, 0]]
    return q


def run_imufusion(trial: Trial) -> FloatArray:
    import imufusion

    settings = imufusion.AhrsSettings()
    settings.convention = imufusion.CONVENTION_ENU
    settings.sample_rate = trial.rate_hz
    settings.gyroscope_range = 2000.0
    settings.gain, settings.acceleration_rejection = 0.5, 10.0
    settings.magnetic_rejection = 10.0
    settings.rejection_timeout = 5.0
    ahrs = imufusion.Ahrs()
    ahrs.set_settings(settings)
    r = trial.recording
    out = np.empty((len(r), 4))
    columns = np.degrees(r.angular_velocity), r.linear_acceleration / 9.81, r.magnetic_field * 1e6
    for i, (w, f, m) in enumerate(zip(*columns, strict=True)):
        ahrs.update(w, f, m)
        out[i] = np.asarray(ahrs.get_quaternion())
    return out[:, [1, 2, 3, 0]]


def run_madgwick(trial: Trial) -> FloatArray:
    from ahrs.filters import Madgwick

    r = trial.recording
    q = Madgwick(
        gyr=r.angular_velocity,
        acc=r.linear_acceleration,
        mag=r.magnetic_field * 1e9,
        frequency=trial.rate_hz,
        gain=0.12,
    ).Q
    return heading_free(np.asarray(q)[:, [1, 2, 3, 0]])


def heading_free(q: FloatArray) -> FloatArray:
    """Return attitudes whose world has x to magnetic north, turned to ENU."""
    x, y, z, w = normalised(q).T
    s = np.sqrt(0.5)
    return np.column_stack([s * (x - y), s * (y + x), s * (z + w), s * (w - z)])


PEERS: dict[str, Callable[[Trial], FloatArray]] = {
    'VQF 2.1.2': run_vqf,
    'VQF offline': run_offline_vqf,
    'imufusion': run_imufusion,
    'ahrs Madgwick': run_madgwick,
}


def run_ours(trial: Trial, name: str, preset: str, **options: Any) -> OrientationResult:
    return run_filter(name, trial.recording, preset=preset, **options)


def error_deg(trial: Trial, q: FloatArray) -> list[float]:
    """Return the rms errors of COLUMNS over every tenth row of the movement."""
    rows = np.flatnonzero(trial.movement)[::10]
    q, truth = q[rows], trial.recording.reference_orientation[rows]
    rms = attitude_errors(q, truth).rms()
    apart = multiply(truth, conjugate(q))
    turn = apart[np.isfinite(apart).all(axis=1)] * [0.0, 0.0, 1.0, 1.0]
    mean = normalised(normalised(turn).mean(axis=0))
    aligned = attitude_errors(multiply(mean, q), truth).rms()
    return [
        *(float(np.degrees(rms[kind])) for kind in ERROR_KINDS),
        float(np.degrees(aligned['total'])),
    ]


def honesty(trial: Trial, result: OrientationResult) -> list[float]:
    """Return normalised squared error per degree of freedom, and the share within 95 %."""
    rows = np.flatnonzero(trial.movement)[::10]
    truth = trial.recording.reference_orientation
    squares = normalised_errors(result.orientation[rows], truth[rows], result.covariance[rows])
    squares = squares[np.isfinite(squares)]
    return [float(np.mean(squares)) / 3.0, float(np.mean(squares < CHI2_95))]


def cross_validated(
    trials: list[Trial], hot: list[Trial], name: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return errors and honesty (trials, 6), and total errors with temperature errors (trials,).

    Each trial has the values that the others choose; `hot`: the trials with temperature errors.
    """

    def found(sample: list[Trial], values: dict[str, float]) -> np.ndarray:
        runs = [run_ours(trial, name, 'robust', **values).orientation for trial in sample]
        return np.array([error_deg(trial, q) for trial, q in zip(sample, runs, strict=True)])

    def errors_of(values: dict[str, float]) -> FloatArray:
        kinds = [found(sample, values)[:, 0] for sample in (trials, hot) if sample]
        return np.mean(kinds, axis=0)

    search = CrossValidation(TUNED | TUNED_BY_FILTER[name], errors_of)
    rows, warm = [], []
    for j, trial in enumerate(trials):
        values = search.best(np.arange(len(trials)) != j)
        result = run_ours(trial, name, 'robust', **values)
        rows.append(error_deg(trial, result.orientation) + honesty(trial, result))
        warm += [found([t], values)[0, 0] for t in hot[j : j + 1]]
    return np.array(rows), np.array(warm)


def freezer_blocks(folder: Path) -> tuple[ImuRecording, ImuRecording]:
    """Return the odd and the even 20 s block means of a real board, one row each."""
    board = import_csv(next(folder.glob('*.csv')), MAPPING)
    block = (board.time // BLOCK_S).astype(int)
    names = ('angular_velocity', 'linear_acceleration', 'magnetic_field', 'temperature')
    rows = [np.flatnonzero(block == k) for k in np.unique(block)]
    columns: dict[str, Any] = {
        name: np.array([np.nanmean(getattr(board, name)[r], axis=0) for r in rows])
        for name in names
    }
    stamp = np.array([board.stamp[r[0]] for r in rows])
    means = ImuRecording(stamp=stamp, device='freeimu', up_axis='+z', **columns)
    return means.rows(slice(1, None, 2)), means.rows(slice(0, None, 2))


def with_thermal_errors(trial: Trial, swept: ImuRecording) -> Trial:
    """Return the trial as that board would have measured it, its temperature swept once."""
    order = np.argsort(swept.temperature)
    known = swept.temperature[order]
    temperature = np.linspace(known[0], known[-1], len(trial.recording))

    def added(name: str) -> FloatArray:
        clean: FloatArray = getattr(trial.recording, name)
        columns = []
        for k in range(3):
            level = getattr(swept, name)[order, k]
            at = np.interp(temperature, known, level) - np.interp(REFERENCE_C, known, level)
            columns.append(clean[:, k] + at)
        return np.column_stack(columns)

    recording = replace(
        trial.recording,
        device=swept.device,
        temperature=temperature,
        angular_velocity=added('angular_velocity'),
        linear_acceleration=added('linear_acceleration'),
        magnetic_field=added('magnetic_field'),
    )
    return replace(trial, recording=recording)


def thermal(
    trials: list[Trial], warmed: list[Trial], fitted: ImuRecording
) -> dict[str, dict[str, float]]:
    """Return mean total errors [deg]: without, with, and with compensated temperature errors."""
    model = fit([EFFECTS[name]() for name in MODEL], [fitted], period=BLOCK_S)
    results: dict[str, dict[str, float]] = {}
    for name, preset in OURS:
        for learn in (True, False):
            if name == 'complementary' and preset == 'paper' and learn:
                continue  # it never learns
            options = {} if learn else {'learn_bias': False}
            sums = np.zeros(3)
            for trial, hot in zip(trials, warmed, strict=True):
                cured = replace(hot, recording=compensate(hot.recording, model))
                for k, variant in enumerate((trial, hot, cured)):
                    sums[k] += error_deg(
                        trial, run_ours(variant, name, preset, **options).orientation
                    )[0]
            label = f'{name} {preset}' + ('' if learn else ', no bias learning')
            kinds = ('without', 'with', 'compensated')
            results[label] = dict(zip(kinds, (sums / len(trials)).tolist(), strict=True))
    return results


def all_errors(
    trials: list[Trial], warmed: list[Trial]
) -> tuple[dict[str, np.ndarray], dict[str, dict[str, float]]]:
    """Return errors by filter (trials, 4 or 6), and means with temperature errors, [deg]."""
    warm: dict[str, dict[str, float]] = {}
    errors: dict[str, np.ndarray] = {}
    for label, run in PEERS.items():
        errors[label] = np.array([error_deg(trial, run(trial)) for trial in trials])
    for name, preset in OURS:
        runs = [(trial, run_ours(trial, name, preset)) for trial in trials]
        errors[f'{name} {preset}'] = np.array(
            [error_deg(trial, run.orientation) + honesty(trial, run) for trial, run in runs]
        )
        if preset == 'robust' and len(trials) > 1:
            label = f'{name} {preset}, cv'
            errors[label], with_errors = cross_validated(trials, warmed, name)
            if warmed:
                means = float(errors[label][:, 0].mean()), float(with_errors.mean())
                warm[label] = dict(zip(('without', 'with'), means, strict=True))
        if preset == 'robust':
            runs = [(trial, run_smoother(name, trial.recording)) for trial in trials]
            errors[f'{name} smoothed'] = np.array(
                [error_deg(trial, run.orientation) + honesty(trial, run) for trial, run in runs]
            )
    return errors, warm


def report(trials: list[Trial], errors: dict[str, np.ndarray]) -> None:
    """Print the tables."""
    print(f'total rms error [deg]\n{"":44}' + ''.join(f'{name[:13]:>14}' for name in errors))
    for i, trial in enumerate(trials):
        print(f'{trial.name:44}' + ''.join(f'{e[i, 0]:14.2f}' for e in errors.values()))
    for k, kind in enumerate(COLUMNS):
        print(f'mean {kind:39}' + ''.join(f'{e[:, k].mean():14.2f}' for e in errors.values()))
    for k, kind in enumerate(('normalised squared error', 'within 95 %'), start=len(COLUMNS)):
        cells = (
            f'{e[:, k].mean():14.2f}' if e.shape[1] > k else f'{"":14}' for e in errors.values()
        )
        print(f'mean {kind:39}' + ''.join(cells))


def report_spread(errors: dict[str, np.ndarray]) -> None:
    """Print how much the factors to VQF depend on which trials there are."""
    vqf = errors['VQF 2.1.2'][:, 0]
    for label in (f'{name}, cv' for name in LIMITS):
        ours, rows = errors[label][:, 0], range(len(vqf))
        without = [np.delete(ours, i).mean() / np.delete(vqf, i).mean() for i in rows]
        better = int(np.count_nonzero(ours < vqf))
        print(
            f"{label}: better than VQF in {better} of {len(vqf)} trials; mean error over VQF's "
            f'with any one trial left out {min(without):.2f} … {max(without):.2f}'
        )


def claims(trials: list[Trial], errors: dict[str, np.ndarray]) -> list[Verdict]:
    """Return the claims about motion as it was measured."""
    vqf = errors['VQF 2.1.2']
    found = []
    for label, limit in LIMITS.items():
        ours = errors[f'{label}, cv']
        total, aligned, worst = ours[:, 0], ours[:, 3], ours[:, 0].max()
        mean = total.mean() / vqf[:, 0].mean()
        nees, share = ours[:, 4].mean(), ours[:, 5].mean()
        found += [
            Verdict(f"{label}, cv: mean total error over VQF's", mean, limit),
            Verdict(
                f"{label}, cv: heading-aligned over VQF's",
                aligned.mean() / vqf[:, 3].mean(),
                ALIGNED_LIMIT,
            ),
            Verdict(f"{label}, cv: worst trial over VQF's", worst / vqf[:, 0].max(), 1.0),
            Verdict(f'{label}, cv: normalised squared error', nees, NEES[1]),
            Verdict(f'{label}, cv: normalised squared error', nees, NEES[0], at_least=True),
            Verdict(f'{label}, cv: within 95 %', share, COVERAGE[0], at_least=True),
            Verdict(f'{label}, cv: within 95 %', share, COVERAGE[1]),
        ]
    offline = errors['VQF offline'][:, 3].mean()
    for name in ('ahrs', 'complementary'):
        aligned = errors[f'{name} smoothed'][:, 3].mean()
        claim = f'{name} smoothed: heading-aligned over offline VQF'
        found.append(Verdict(claim, aligned / offline, ALIGNED_LIMIT))
    for i, trial in enumerate(trials):
        if trial.name.startswith('01_'):
            slow = errors['ahrs paper'][i, 0]
            found.append(Verdict('slow trial 01, ahrs paper', slow, SLOW_LIMIT_DEG, '°'))
    return found


def thermal_claims(results: dict[str, dict[str, float]]) -> list[Verdict]:
    """Print the table; return the claims about temperature errors added and compensated."""
    print("\na real board's temperature errors added: mean total error [deg]")
    found = []
    for label, row in results.items():
        print(f'{label:44}' + ''.join(f'{kind} {value:7.2f}   ' for kind, value in row.items()))
        if 'compensated' in row:
            factor = row['compensated'] / row['without']
            found.append(
                Verdict(f'{label}: compensated over without thermal errors', factor, THERMAL_LIMIT)
            )
        if label.endswith(('robust', 'cv')):
            raw = row['with'] / row['without']
            found.append(Verdict(f'{label}: raw over without thermal errors', raw, RAW_LIMIT))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--data', type=Path, default=DATA)
    parser.add_argument('--freezer', type=Path, help='a board warming up from cold, as CSV')
    parser.add_argument('--json', type=Path)
    options = parser.parse_args()
    files = sorted(options.data.glob('*.mat'))
    if not files:
        parser.error(f'--data {options.data}: no *.mat file there')
    trials = [load_trial(path) for path in files]
    freezer = options.freezer or options.data.parent / 'freeimu_freezer'
    warmed: list[Trial] = []
    if freezer.is_dir():
        swept, fitted = freezer_blocks(freezer)
        warmed = [with_thermal_errors(trial, swept) for trial in trials]
    errors, warm = all_errors(trials, warmed)
    report(trials, errors)
    if len(trials) > 1:
        report_spread(errors)
    found = claims(trials, errors) if len(trials) > 1 else []
    if warmed:
        warm |= thermal(trials, warmed, fitted)
    failed = judge([*found, *thermal_claims(warm)])
    if options.json:
        rows = {label: e.tolist() for label, e in errors.items()}
        content = {
            'trials': [trial.name for trial in trials],
            'kinds': COLUMNS,
            'errors_deg': rows,
            'thermal_deg': warm,
            'failed': failed,
        }
        options.json.write_text(json.dumps(content, indent=1) + '\n')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
