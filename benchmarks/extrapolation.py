# SPDX-License-Identifier: Apache-2.0
"""Outside the fitted temperatures: the tangent, or the error of the edge?

python benchmarks/extrapolation.py [--seeds N] [--share S]

A model is fitted to the middle of the temperatures of a recording (S of their range) and judged
where it is colder and hotter: rms of block means about the level in the middle, with the tangent
(`--extrapolate line`) and with the error held as at the edge (`clamp`), beside nothing subtracted.
Devices: the bundled bags, campaigns of the independent simulator, and the two public recordings
below ../shared/data (freezer, climatic chamber). Models: a line per axis, a cubic. Exit code 1
where the default is not the better one, by the median over channels (sensor and axis) of a set.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.tables.csv_import import import_csv
from independent_simulator.campaign import draw_campaign
from thermal_comp.compensation.recording import (
    DEFAULT_EXTRAPOLATION,
    EXTRAPOLATIONS,
    compensate,
)
from thermal_comp.data.conditions import Sensor
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.bias_temperature_curvature import BiasTemperatureCurvature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.inputs import usable_sensors
from verdict import Verdict, judge

from imu_recording import ImuRecording, read_bag

ROOT = Path(__file__).resolve().parents[1]
MODELS: dict[str, tuple[Effect, ...]] = {
    'line': (BiasTemperature(),),
    'cubic': (BiasTemperature(), BiasTemperatureCurvature()),
}
PERIOD_S = 20.0


def campaigns(seeds: int) -> Iterator[tuple[str, list[ImuRecording]]]:
    """Yield name and runs of every device."""
    for device in ('dut1', 'dut2', 'dut3', 'hidden_effect'):
        bags = [ROOT / 'bags' / f'{device}_{axis}' for axis in 'xyz']
        yield 'bundled bags', [read_bag(bag) for bag in bags]
    for seed in range(1, seeds + 1):
        yield (
            'independent simulator',
            list(draw_campaign(seed, 'full_lab', rivals=False).recordings),
        )
    data = ROOT.parent / 'shared' / 'data'
    for name, file in (('freeimu', 'Tempdata01-02-14.csv'), ('tofupilot', 'imu_raw_data.csv')):
        path = next(iter(data.glob(f'{name}_*/{file}')), None)
        if path is not None:
            recording = import_csv(path, ROOT / 'examples' / f'{name}_mapping.yaml')
            yield name, [replace(recording, run=name, device=name)]


def middle_of(recordings: Sequence[ImuRecording], share: float) -> tuple[float, float]:
    warmth = np.concatenate([r.temperature[np.isfinite(r.temperature)] for r in recordings])
    low, high = np.quantile(warmth, [0.001, 0.999])
    margin = 0.5 * (1.0 - share) * (high - low)
    return float(low + margin), float(high - margin)


def inside_only(run: PreparedRun, low: float, high: float) -> PreparedRun:
    """Return the run with the blocks, and so the range, of the middle."""
    kept = (run.temperature >= low) & (run.temperature <= high)
    conditions = replace(
        run.conditions, temperature=np.clip(run.conditions.temperature, low, high)
    )
    measured = {sensor: values[kept] for sensor, values in run.measured.items()}
    return replace(
        run,
        conditions=conditions,
        starts=run.starts[kept],
        slot=run.slot[kept],
        measured=measured,
        cv_group=run.cv_group[kept],
    )


def left_outside(
    raw: Sequence[PreparedRun],
    done: Sequence[ImuRecording],
    span: tuple[float, float],
    sensors: Sequence[Sensor],
) -> dict[Sensor, FloatArray]:
    """Return (3,) rms outside the range about the level inside, per sensor."""
    runs = prepare(done, period=PERIOD_S)
    found = {}
    for sensor in sensors:
        squares = []
        for before, run in zip(raw, runs, strict=True):
            t = before.temperature
            inside = (t >= span[0]) & (t <= span[1])
            values = run.measured[sensor]
            level = np.nanmean(values[inside], axis=0)
            squares.append((values[~inside] - level) ** 2)
        found[sensor] = np.sqrt(np.nanmean(np.concatenate(squares), axis=0))
    return found


def judged(recordings: list[ImuRecording], share: float) -> list[dict[str, Any]]:
    """Return what each model leaves outside, per channel."""
    span = middle_of(recordings, share)
    raw = prepare(recordings, period=PERIOD_S)
    sensors = usable_sensors(raw)[0]
    nothing = left_outside(raw, recordings, span, sensors)
    rows = []
    for name, effects in MODELS.items():
        model = fit_prepared(effects, [inside_only(run, *span) for run in raw])
        left = {
            how: left_outside(
                raw, [compensate(r, model, extrapolation=how) for r in recordings], span, sensors
            )
            for how in EXTRAPOLATIONS
        }
        for sensor in sensors:
            rows += [
                {
                    'model': name,
                    'sensor': sensor,
                    'nothing': nothing[sensor][axis],
                    **{how: left[how][sensor][axis] for how in EXTRAPOLATIONS},
                }
                for axis in range(3)
            ]
    return rows


def main() -> int:
    """Judge every set; exit 1 where the default is not the better one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seeds', type=int, default=10, help='campaigns of the simulator')
    parser.add_argument('--share', type=float, default=0.5, help='of the range that is fitted')
    options = parser.parse_args()
    found: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for name, recordings in campaigns(options.seeds):
        for row in judged(recordings, options.share):
            found.setdefault((name, row['model']), []).append(row)
    other = next(how for how in EXTRAPOLATIONS if how != DEFAULT_EXTRAPOLATION)
    print('set                    model  channels  line better   median rms ratio to nothing')
    verdicts = []
    for (name, model), rows in found.items():
        ratio = {
            how: float(np.median([row[how] / row['nothing'] for row in rows]))
            for how in EXTRAPOLATIONS
        }
        better = float(np.mean([row['line'] < row['clamp'] for row in rows]))
        worst = max(row['line'] / row['clamp'] for row in rows)
        print(
            f'{name:22} {model:6} {len(rows):8} {better:12.0%}   line {ratio["line"]:.2f}, clamp '
            f'{ratio["clamp"]:.2f}; line at worst {worst:.1f} × clamp',
            flush=True,
        )
        claim = f'{name}, {model}: {DEFAULT_EXTRAPOLATION} leaves, in what {other} leaves'
        verdicts.append(Verdict(claim, ratio[DEFAULT_EXTRAPOLATION] / ratio[other], 1.0))
    return 1 if judge(verdicts) else 0


if __name__ == '__main__':
    raise SystemExit(main())
