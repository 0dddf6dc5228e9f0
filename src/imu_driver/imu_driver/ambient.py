# SPDX-License-Identifier: Apache-2.0
"""Temperature of the surroundings over time: a number, or a CSV as `plan --csv` writes it."""

from __future__ import annotations

import csv
from bisect import bisect_right
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from imu_recording.user_error import UserError

COLUMNS = ('time_s', 'temperature_c')


class AmbientError(UserError):
    """A temperature law that cannot be read; the message names the file and the row."""


def ambient_law(text: str) -> Callable[[float], float]:
    """Return the temperature [°C] as a function of time [s].

    `text` is a number, or the path of a CSV with the columns time_s, temperature_c; between its
    rows the temperature is interpolated, before and after them it holds.
    """
    try:
        constant = float(text)
    except ValueError:
        return _interpolated(*_read(Path(text)))
    return lambda _: constant


def _read(path: Path) -> tuple[list[float], list[float]]:
    try:
        with path.open(newline='', encoding='utf-8') as file:
            rows = csv.DictReader(line for line in file if not line.startswith('#'))
            missing = [name for name in COLUMNS if name not in (rows.fieldnames or ())]
            if missing:
                raise AmbientError(f'{path}: no column {missing[0]}; it needs {",".join(COLUMNS)}')
            points = [(float(row['time_s']), float(row['temperature_c'])) for row in rows]
    except (TypeError, ValueError) as error:
        if isinstance(error, AmbientError):
            raise
        raise AmbientError(f'{path}: {error}') from None
    if not points:
        raise AmbientError(f'{path}: no rows')
    if any(later[0] < earlier[0] for earlier, later in pairwise(points)):
        raise AmbientError(f'{path}: time_s must rise')
    return [time for time, _ in points], [temperature for _, temperature in points]


def _interpolated(times: list[float], temperatures: list[float]) -> Callable[[float], float]:
    def law(time: float) -> float:
        after = bisect_right(times, time)
        if after == 0 or after == len(times):
            return temperatures[min(after, len(times) - 1)]
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        return temperatures[after - 1] + share * (temperatures[after] - temperatures[after - 1])

    return law
