# SPDX-License-Identifier: Apache-2.0
"""Every tuned parameter chosen without the trial it is judged on.

The values of a search are steps of the series 1, 2, 5, 10 … It begins at orders of magnitude,
moves one parameter after the other to the neighbouring step while that lowers the mean error of
the trials it may see, and ends where no step does. Searches that leave out one trial each share
most of their ways, so every set of values is tried once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import floor, log10

import numpy as np
from imu_recording.recording import FloatArray

SERIES = (1.0, 2.0, 5.0)
LEAST_GAIN = 0.002
"""Part of the mean error that a step has to save."""

Steps = Mapping[str, int]


def step_of(value: float) -> int:
    """Return the step of the series nearest below a value.

    >>> [step_of(v) for v in (1.0, 2.0, 0.05, 3e-4)]
    [0, 1, -4, -11]
    """
    decade = floor(log10(value) + 1e-9)
    return len(SERIES) * decade + sum(value / 10.0**decade >= s - 1e-9 for s in SERIES) - 1


def value_of(step: int) -> float:
    """Return the value of a step.

    >>> [value_of(k) for k in (0, 1, -4, 5)]
    [1.0, 2.0, 0.05, 50.0]
    """
    decade, k = divmod(step, len(SERIES))
    return float(f'{SERIES[k]:g}e{decade}')


class CrossValidation:
    """Searches over parameters, each blind for some trials; `errors_of` values: (trials,)."""

    def __init__(
        self, start: Mapping[str, float], errors_of: Callable[[dict[str, float]], FloatArray]
    ) -> None:
        self._start: Steps = {name: step_of(value) for name, value in start.items()}
        self._errors_of = errors_of
        self._tried: dict[tuple[int, ...], FloatArray] = {}

    def errors(self, steps: Steps) -> FloatArray:
        """Return the errors (trials,) with the values of these steps."""
        key = tuple(steps.values())
        if key not in self._tried:
            self._tried[key] = self._errors_of(values_of(steps))
        return self._tried[key]

    def best(self, seen: FloatArray) -> dict[str, float]:
        """Return the values that the trials of a mask (trials,) choose."""
        best, lowest = self._start, float(np.mean(self.errors(self._start)[seen]))
        is_better = True
        while is_better:
            is_better = False
            for name in self._start:
                for direction in (1, -1):
                    moved = {**best, name: best[name] + direction}
                    while (error := float(np.mean(self.errors(moved)[seen]))) < lowest * (
                        1.0 - LEAST_GAIN
                    ):
                        best, lowest, is_better = moved, error, True
                        moved = {**best, name: best[name] + direction}
        return values_of(best)


def values_of(steps: Steps) -> dict[str, float]:
    """Return the values of steps, by name."""
    return {name: value_of(step) for name, step in steps.items()}
