# SPDX-License-Identifier: Apache-2.0
"""The view of a tab: sensor, axis, a place in the runs; and all runs on one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import PHASES
from numpy.typing import NDArray

from imu_workbench.report.figures.measured import PHASE_NAMES
from imu_workbench.web.case.figures.run_blocks import RunBlocks
from imu_workbench.web.case.stored_bag import StoredBag

PHASE_LABELS = PHASE_NAMES | {'precondition': 'reference', 'final': 'final'}
"""What a phase is called on the page."""
RUN_GAP_SHARE = 0.03
"""Gap between two runs on the common axis, as a share of all runs together."""


@dataclass(frozen=True)
class Place:
    """A cell of the map of where a model fails."""

    run: str
    phase: str | None
    """None: any; so are cycle None and bin None."""
    cycle: int | None
    low: float | None = None
    """Die temperature from here to 10 K above [°C], where the runs have no phases."""

    def rows(self, blocks: RunBlocks) -> NDArray[np.bool_]:
        """(m,) blocks of the run that belong to the place."""
        rows = np.full(len(blocks.time), blocks.run == self.run)
        if self.phase is not None:
            rows &= blocks.phase == PHASES.index(self.phase)
        if self.cycle is not None:
            rows &= blocks.cycle == self.cycle
        if self.low is not None:
            rows &= (blocks.temperature >= self.low) & (blocks.temperature < self.low + 10.0)
        return rows

    def __str__(self) -> str:
        parts = [self.run]
        if self.phase is not None:
            parts.append(PHASE_LABELS[self.phase])
        if self.cycle:
            parts.append(f'cycle {self.cycle}')
        if self.low is not None:
            parts.append(f'{self.low:.0f} … {self.low + 10:.0f} °C')
        return ', '.join(parts)


@dataclass(frozen=True)
class View:
    """What the plots show."""

    sensor: str
    axis: int = 0
    place: Place | None = None
    window: tuple[float, float] | None = None
    """Part of the timeline that every plot shows [h]; None: all of it."""

    @property
    def axis_name(self) -> str:
        """'x', 'y' or 'z'."""
        return 'xyz'[self.axis]


@dataclass(frozen=True)
class Timeline:
    """Runs one after the other on one axis."""

    runs: tuple[str, ...]
    starts: tuple[float, ...]
    """Where each run begins on the axis [h]."""
    lengths: tuple[float, ...]
    """[h]."""

    def start(self, run: str) -> float:
        """Return where a run begins [h]."""
        return self.starts[self.runs.index(run)]

    @property
    def end(self) -> float:
        """Where the last run ends [h]."""
        return self.starts[-1] + self.lengths[-1]

    def span(self, blocks: Sequence[RunBlocks], place: Place) -> tuple[float, float] | None:
        """Return the part of the axis that a place takes, with a margin [h]."""
        for run in blocks:
            rows = np.flatnonzero(place.rows(run))
            if len(rows):
                first, last = run.time[rows[0]] / 3600.0, run.time[rows[-1]] / 3600.0
                margin = 0.15 * (last - first) + 0.05
                start = self.start(run.run)
                return start + first - margin, start + last + margin
        return None


def inside_window(
    blocks: Sequence[RunBlocks], timeline: Timeline | None, window: tuple[float, float] | None
) -> NDArray[np.bool_]:
    """(m,) blocks of all runs, one after the other, that lie in a part of the timeline [h]."""
    if window is None or timeline is None:
        return np.ones(sum(len(run.time) for run in blocks), dtype=bool)
    hours = [timeline.start(run.run) + run.time / 3600.0 for run in blocks]
    together = np.concatenate(hours)
    inside: NDArray[np.bool_] = (together >= window[0]) & (together <= window[1])
    return inside


def timeline_of(bags: Sequence[StoredBag]) -> Timeline:
    """Return the runs of the bags one after the other."""
    lengths = [bag.duration / 3600.0 for bag in bags]
    gap = RUN_GAP_SHARE * sum(lengths) if len(bags) > 1 else 0.0
    starts = [sum(lengths[:k]) + k * gap for k in range(len(bags))]
    return Timeline(tuple(bag.run for bag in bags), tuple(starts), tuple(lengths))
