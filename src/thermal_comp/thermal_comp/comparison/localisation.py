# SPDX-License-Identifier: Apache-2.0
"""Where a model errs most: phases, cycles, orientations, branches and temperatures, ranked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from imu_recording.recording import PHASES, UP_AXES, FloatArray, IntArray
from numpy.typing import NDArray

from thermal_comp.data.prepared_run import PreparedRun

TEMPERATURE_BIN_C = 10.0
"""Width of a temperature bin [°C]."""
STEADY_RATE_C_PER_MIN = 0.2
"""Rate of the die temperature from which a block is on a branch, rising or falling [°C/min]."""
LEAST_BLOCKS_IN_GROUP = 5
"""Blocks that a group has at least."""
MOST_GROUPS = 16
"""Groups that are returned at most, worst first."""


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

    def to_dict(self) -> dict[str, Any]:
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
    squares = residual[seen] ** 2
    weighed = (squares / np.where(floor > 0.0, floor, np.inf) ** 2).mean(axis=1)
    found = []
    for keys, labels, member in groupings(runs):
        inside = member[seen] >= 0
        group = member[seen][inside]
        blocks = np.bincount(group, minlength=len(labels))
        sums = [np.bincount(group, w, len(labels)) for w in (*squares[inside].T, weighed[inside])]
        for k in np.flatnonzero(blocks >= LEAST_BLOCKS_IN_GROUP):
            *rms, ratio = (float(np.sqrt(total[k] / blocks[k])) for total in sums)
            names = dict(zip(keys, labels[k], strict=True))
            found.append(Where(group=names, rms=np.array(rms), ratio=ratio, blocks=int(blocks[k])))
    found.sort(key=lambda where: -where.ratio)
    return tuple(found[:MOST_GROUPS])


Grouping = tuple[tuple[str, ...], list[tuple[Any, ...]], IntArray]
"""Names of the keys, label of each group, and the group of each block (m,), −1 for none."""


def groupings(runs: Sequence[PreparedRun]) -> list[Grouping]:
    """Return the ways to group the blocks of all runs, one below the other."""
    phase = np.concatenate([run.phase for run in runs])
    cycle = np.concatenate([run.cycle for run in runs])
    both = np.where((phase >= 0) & (cycle > 0), cycle * len(PHASES) + phase, -1)
    temperature = np.concatenate([run.temperature for run in runs])
    low = np.floor(temperature / TEMPERATURE_BIN_C).astype(np.int64)
    branch = np.concatenate([branches(run) for run in runs])
    ways = [
        _grouped(('phase',), phase, phase >= 0, _phase_label),
        _grouped(('cycle',), cycle, cycle > 0, _number_label),
        _grouped(('phase', 'cycle'), both, both >= 0, _phase_and_cycle_label),
        _grouped(('branch',), branch, branch != 0, _branch_label),
        _grouped(('temperature',), low, np.full(len(low), True), _temperature_label),
    ]
    if len(runs) > 1:
        up = [UP_AXES.index(orientation(run)) for run in runs]
        axis = np.repeat(up, [len(run) for run in runs])
        ways.append(_grouped(('orientation',), axis, np.full(len(axis), True), _up_axis_label))
    return ways


def _grouped(
    keys: tuple[str, ...],
    code: IntArray,
    known: NDArray[np.bool_],
    label: Callable[[int], tuple[Any, ...]],
) -> Grouping:
    """Return the grouping of blocks by a code (m,), those where it is not known in no group."""
    codes, member = np.unique(code, return_inverse=True)
    return keys, [label(k) for k in codes.tolist()], np.where(known, member, -1)


def _phase_label(code: int) -> tuple[str]:
    return (PHASES[code],)


def _number_label(code: int) -> tuple[int]:
    return (code,)


def _phase_and_cycle_label(code: int) -> tuple[str, int]:
    return PHASES[code % len(PHASES)], code // len(PHASES)


def _branch_label(code: int) -> tuple[str]:
    return ('rising' if code > 0 else 'falling',)


def _up_axis_label(code: int) -> tuple[str]:
    return (UP_AXES[code],)


def _temperature_label(code: int) -> tuple[str]:
    """Return the range of a bin.

    >>> _temperature_label(-1)
    ('-10 … 0 °C',)
    """
    low = int(code * TEMPERATURE_BIN_C)
    return (f'{low} … {low + int(TEMPERATURE_BIN_C)} °C',)


def branches(run: PreparedRun) -> IntArray:
    """Return 1 where the die temperature rises, −1 where it falls, else 0, for each block (m,)."""
    if len(run) < 2:
        return np.zeros(len(run), dtype=np.int64)
    rate = np.gradient(run.temperature, run.time) * 60.0
    return np.where(np.abs(rate) > STEADY_RATE_C_PER_MIN, np.sign(rate), 0.0).astype(np.int64)


def orientation(run: PreparedRun) -> str:
    """Return the axis of a run that points up, by its true specific force."""
    up = run.conditions.specific_force.mean(axis=0)
    axis = int(np.argmax(np.abs(up)))
    return UP_AXES[2 * axis + int(up[axis] < 0.0)]
