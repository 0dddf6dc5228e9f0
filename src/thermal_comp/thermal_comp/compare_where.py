# SPDX-License-Identifier: Apache-2.0
"""Where a model fails: phase, cycle, orientation, branch, temperature, ranked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from imu_recording.recording import PHASES, UP_AXES, FloatArray, IntArray

from thermal_comp.prepared_run import PreparedRun

BIN_C = 10.0
"""Width of a temperature bin [°C]."""
STEADY_C_PER_MIN = 0.2
"""Below this rate of the die temperature a block is on no branch [°C/min]."""
SMALLEST_GROUP = 5
"""Fewer blocks make no group."""
LISTED = 16
"""Groups kept, worst first."""


@dataclass(frozen=True, eq=False)
class Where:
    """Error of one group of blocks."""

    group: Mapping[str, Any]
    """What the blocks have in common, e.g. {'phase': 'ramp_up', 'cycle': 2}."""
    rms: FloatArray
    """(3,) [unit]."""
    ratio: float
    """Rms over the axes in units of the noise floor."""
    blocks: int

    def content(self) -> dict[str, Any]:
        """Return plain values."""
        return {**self.group, 'ratio': self.ratio, 'rms': self.rms, 'blocks': self.blocks}

    def __str__(self) -> str:
        text = ', '.join(f'{key} {value}' for key, value in self.group.items())
        return f'{text}: {self.ratio:.2f} × noise floor'


def rank_where(
    runs: Sequence[PreparedRun], residuals: Sequence[FloatArray], floor: FloatArray
) -> tuple[Where, ...]:
    """Return the groups in which the residuals (m, 3), one per run, are largest.

    `floor` (3,) is the noise floor [unit]; an axis without noise does not count.
    """
    residual = np.concatenate(list(residuals))
    seen = np.isfinite(residual).all(axis=1)
    weighed = np.where(floor > 0.0, residual / np.where(floor > 0.0, floor, 1.0), 0.0)
    found = []
    for keys, labels in groupings(runs):
        members: dict[Any, list[int]] = {}
        for row in np.flatnonzero(seen).tolist():
            members.setdefault(labels[row], []).append(row)
        members.pop(None, None)
        for label, rows in members.items():
            if len(rows) >= SMALLEST_GROUP:
                rms = np.sqrt((residual[rows] ** 2).mean(axis=0))
                ratio = float(np.sqrt((weighed[rows] ** 2).mean()))
                group = dict(zip(keys, label, strict=True))
                found.append(Where(group, rms, ratio, len(rows)))
    found.sort(key=lambda where: -where.ratio)
    return tuple(found[:LISTED])


def groupings(runs: Sequence[PreparedRun]) -> list[tuple[tuple[str, ...], list[Any]]]:
    """Return the ways to group blocks: names of the keys, one label or None per block."""
    phase = _stacked(runs, lambda run: run.phase)
    cycle = _stacked(runs, lambda run: run.cycle)
    names: list[Any] = [PHASES[k] if k >= 0 else None for k in phase]
    numbers: list[Any] = [int(k) if k > 0 else None for k in cycle]
    both = [
        None if p is None or c is None else (p, c) for p, c in zip(names, numbers, strict=True)
    ]
    ways: list[tuple[tuple[str, ...], list[Any]]] = [
        (('phase',), [n and (n,) for n in names]),
        (('cycle',), [n and (n,) for n in numbers]),
        (('phase', 'cycle'), both),
        (('branch',), [b and (b,) for run in runs for b in branches(run)]),
        (('temperature',), [(b,) for run in runs for b in temperature_bins(run.temperature)]),
    ]
    if len(runs) > 1:
        up = [label for run in runs for label in [(orientation(run),)] * len(run)]
        ways.append((('orientation',), up))
    return ways


def branches(run: PreparedRun) -> list[str | None]:
    """Return 'rising', 'falling' or None for each block, by the die temperature's rate."""
    if len(run) < 2:
        return [None] * len(run)
    rate = np.gradient(run.temperature, run.time) * 60.0
    return [
        'rising' if r > STEADY_C_PER_MIN else 'falling' if r < -STEADY_C_PER_MIN else None
        for r in rate
    ]


def temperature_bins(temperature: FloatArray) -> list[str]:
    """Return the bin of each temperature.

    >>> temperature_bins(np.array([-3.0, 12.0]))
    ['-10 … 0 °C', '10 … 20 °C']
    """
    low = (np.floor(temperature / BIN_C) * BIN_C).astype(int)
    return [f'{t} … {t + int(BIN_C)} °C' for t in low.tolist()]


def orientation(run: PreparedRun) -> str:
    """Return the axis of a run that points up, by its true specific force."""
    up = run.conditions.specific_force.mean(axis=0)
    axis = int(np.argmax(np.abs(up)))
    return UP_AXES[2 * axis + int(up[axis] < 0.0)]


def _stacked(runs: Sequence[PreparedRun], take: Callable[[PreparedRun], IntArray]) -> IntArray:
    return np.concatenate([take(run) for run in runs])
