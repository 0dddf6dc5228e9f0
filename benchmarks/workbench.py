# SPDX-License-Identifier: Apache-2.0
"""How long the workbench takes: python benchmarks/workbench.py [--rate 1 100].

Three runs of 12 h of one device, made from bags/dut1_? at the given rates, stored as the server
stores what it has read; then what a user does, through real worker processes, up to the text that
goes to the browser: first plot, model and map, zoom, adding an effect with every plot redrawn.
Exit code 1 where a claim fails; the load of the machine is said, for it counts. What the browser
adds shows `make test-web`, how often it draws live_view.py.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import orjson
from imu_recording.plausibility import admitted
from imu_workbench.web.case.figures.failure_map import failure_figure, failure_map
from imu_workbench.web.case.figures.noise import allan_figure, spectrum_figure
from imu_workbench.web.case.figures.scatter import phase_figure, rate_figure, temperature_figure
from imu_workbench.web.case.figures.time_course import time_figure, time_lines
from imu_workbench.web.case.stored_bag import StoredBag, store_recording
from imu_workbench.web.case.tasks import Change, change_task, prepare_task, version_task
from imu_workbench.web.case.version import Version
from imu_workbench.web.case.view import View
from imu_workbench.web.work.jobs import Job, warm_up
from verdict import Verdict, judge

from imu_recording import ImuRecording, read_bag

BAGS = Path(__file__).resolve().parents[1] / 'bags'
HOURS = 12.0
NOISE = {'angular_velocity': 2e-4, 'linear_acceleration': 2e-3, 'magnetic_field': 3e-8}
"""White noise of the samples made between those of the bag [SI unit s^½]: rms over √rate."""
VIEW = View('accelerometer', 1)


def resampled(recording: ImuRecording, rate: float, seed: int) -> ImuRecording:
    """The recording at another rate, with noise of its own."""
    rng = np.random.default_rng(seed)
    n = int(HOURS * 3600 * rate)
    stamp = recording.stamp[0] + (np.arange(n) * (1e9 / rate)).astype(np.int64)
    time, known = (stamp - stamp[0]) * 1e-9, recording.time
    held = np.clip(np.searchsorted(known, time, side='right') - 1, 0, None)
    columns: dict[str, Any] = {}
    for item in fields(recording):
        column = getattr(recording, item.name)
        if not isinstance(column, np.ndarray) or item.name == 'stamp':
            continue
        columns[item.name] = column[held]
        if item.name in NOISE:
            columns[item.name] += rng.normal(0.0, NOISE[item.name] * rate**0.5, (n, 3))
    return replace(recording, stamp=stamp, **columns)


def seconds(act: Callable[[], Any]) -> tuple[float, Any]:
    start = time.perf_counter()
    value = act()
    return time.perf_counter() - start, value


def redrawn(bags: list[StoredBag], version: Version, earlier: Version | None) -> int:
    """Every plot of the page as it goes to the browser, in bytes."""
    figures = [
        time_figure(bags, version, VIEW, earlier),
        failure_figure(failure_map(version, VIEW), VIEW),
        *(draw(version, VIEW) for draw in (temperature_figure, rate_figure, phase_figure)),
        spectrum_figure(version, VIEW),
        allan_figure(version, VIEW, bags),
    ]
    return len(orjson.dumps(figures))


def measure(rate: float, folder: Path) -> dict[str, float]:
    bags = [
        store_recording(
            admitted(resampled(read_bag(BAGS / f'dut1_{axis}'), rate, seed)), folder / axis
        )
        for seed, axis in enumerate('xyz')
    ]
    prepared = folder / 'prepared.runs'
    first, _ = seconds(lambda: orjson.dumps(time_figure(bags, None, VIEW)))
    took, _ = seconds(lambda: Job(prepare_task, bags, prepared).wait())
    arguments = (prepared, None, 'line per axis', [])
    fit, opened = seconds(lambda: Job(version_task, *arguments).wait())
    line = opened.version
    draw, _ = seconds(lambda: redrawn(bags, line, None))
    zoom, _ = seconds(lambda: orjson.dumps(time_lines(bags, line, VIEW, (5.0, 6.0))))
    change = Change('thermal_lag', ('accelerometer',))
    add, lag = seconds(lambda: Job(change_task, prepared, line.model_text, change, []).wait())
    again, _ = seconds(lambda: redrawn(bags, lag, line))
    return {
        'first plot': first,
        'model and map': took + fit + draw,
        'zoom': zoom,
        'add, refit, redraw': add + again,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--rate', type=float, nargs='+', default=[1.0, 100.0], help='[Hz]')
    rates = parser.parse_args().rate
    print(f'load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores')
    warm_up()
    verdicts: list[Verdict] = []
    for rate in rates:
        with TemporaryDirectory() as folder:
            found = measure(rate, Path(folder))
        print(f'{rate:g} Hz: ' + ', '.join(f'{name} {value:.2f}' for name, value in found.items()))
        most = 3.0 if rate <= 1.0 else 5.0
        verdicts += [
            Verdict(f'{name} at {rate:g} Hz', found[name], limit, 's')
            for name, limit in (('first plot', most), ('zoom', 0.3), ('add, refit, redraw', 3.0))
        ]
    return 1 if judge(verdicts) else 0


if __name__ == '__main__':
    sys.exit(main())
